"""Measuring photos from the command line."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from green import photo, save_run
from PIL import Image

from laesi_tf import predict as command
from laesi_tf.estimators.base import LeafMeasurement, Measurement
from laesi_tf.reporting.leaf_records import make_records
from laesi_tf.reporting.overlay import PREDICTED_COLOUR

pytestmark = pytest.mark.usefixtures("stand_in_networks")

Rows = list[dict[str, object]]
COLUMNS = {
    "photo",
    "leaf",
    "area_cm2",
    "uncertainty_cm2",
    "px_per_mm",
    "tilt_deg",
    "method",
    "refused",
    "error",
}
COLUMNS |= {"length_mm", "width_mm", "perimeter_mm", "holes_cm2", "note", "sample", "overlay"}
PERCENT = 100 * math.pi * 0.3**2


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    return {task: save_run(folder / task, task, size=(96, 96)) for task in ("area", "mask")}


def save(path: Path, *size: int) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(photo(*size)).save(path)
    return path


def predict(out: Path, *arguments: object) -> Rows:
    json_file = out.parent / f"{out.name}.json"
    command.main([*map(str, arguments), "--out", str(out), "--json", str(json_file)])
    return json.loads(json_file.read_text())


def test_area_of_each_photo(
    runs: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = [save(tmp_path / "in" / name, 96, 96) for name in ("a.png", "b.tif")]
    rows = predict(tmp_path / "out", *photos, "--model", runs["area"])
    assert [row["photo"] for row in rows] == [str(path) for path in photos]
    for row in rows:
        assert row["area_cm2"] == pytest.approx(PERCENT, rel=0.03)
        assert set(row) == COLUMNS
        assert row["leaf"] == 1 and row["refused"] is False
        assert (row["px_per_mm"], row["method"], row["error"]) == (None, "regression", None)
    assert f"{rows[0]['area_cm2']:.2f} cm2" in capsys.readouterr().out


def test_known_scale(runs: dict[str, Path], tmp_path: Path) -> None:
    (row,) = predict(
        tmp_path / "out", save(tmp_path / "a.png", 300, 400), "--model", runs["mask"], "--px-per-mm", 4
    )
    assert row["area_cm2"] == pytest.approx(math.pi * 90**2 / 16 / 100, rel=0.03) and row["px_per_mm"] == 4.0


def test_refusal_names_the_flag_that_helps(runs: dict[str, Path], tmp_path: Path) -> None:
    (row,) = predict(tmp_path / "out", save(tmp_path / "a.png", 96, 96), "--model", runs["mask"])
    assert row["area_cm2"] is None and "--px-per-mm" in str(row["error"])
    assert row["refused"] is True and row["leaf"] is None


def test_folder_with_bad_photos(
    runs: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "in"
    whole = save(folder / "good.PNG", 96, 96).read_bytes()
    (folder / "bad.png").write_bytes(whole[: len(whole) // 2])
    (folder / "iphone.heic").write_bytes(b"\0\0\0\x18ftypheic" + bytes(40))
    (folder / "notes.txt").write_text("no photo")
    rows = predict(tmp_path / "out", folder, tmp_path / "none.jpg", "--model", runs["area"])
    errors = {Path(str(row["photo"])).name: row["error"] for row in rows}
    assert list(errors) == ["bad.png", "good.PNG", "iphone.heic", "none.jpg"] and errors["good.PNG"] is None
    assert "cannot be decoded" in str(errors["bad.png"]) and "HEIC" in str(errors["iphone.heic"])
    assert "leaves measured: 1, photos refused: 0, skipped: 3" in capsys.readouterr().out


def test_overlays_of_one_name_do_not_replace_each_other(runs: dict[str, Path], tmp_path: Path) -> None:
    photos = [
        save(tmp_path / folder / name, 96, 96) for folder, name in [("1", "leaf.png"), ("2", "Leaf.png")]
    ]
    photos.append(save(tmp_path / "1" / "leaf.bmp", 96, 96))
    predict(tmp_path / "out", *photos, "--model", runs["area"])
    assert len({path.name.lower() for path in (tmp_path / "out").glob("*.overlay.jpg")}) == 3


def test_overlays_are_no_photos_of_the_next_run(runs: dict[str, Path], tmp_path: Path) -> None:
    original = save(tmp_path / "leaf.png", 96, 96).read_bytes()
    for _ in range(2):
        assert len(predict(tmp_path / "out", tmp_path, "--model", runs["area"], "--recursive")) == 1
    assert (tmp_path / "leaf.png").read_bytes() == original


def test_overlay_shows_the_outline_and_is_of_handy_size(runs: dict[str, Path], tmp_path: Path) -> None:
    models = ["--model", runs["area"], "--mask-model", runs["mask"], "--guess"]
    predict(tmp_path / "out", save(tmp_path / "a.png", 1800, 2400), *models)
    overlay = np.asarray(Image.open(tmp_path / "out" / "a.overlay.jpg"))
    assert overlay.shape[1] == 1600 and 1200 < overlay.shape[0] < 1500
    is_outline = np.abs(overlay.astype(int) - PREDICTED_COLOUR).max(axis=2) < 40
    columns = np.nonzero(is_outline.any(axis=0))[0]
    # A disk of 0.3 of the shorter side in the middle.
    assert (columns.min(), columns.max()) == pytest.approx((800 - 360, 800 + 360), abs=14)


def test_a_given_scale_needs_no_ruling(runs: dict[str, Path], tmp_path: Path) -> None:
    photo_file = save(tmp_path / "scan.png", 300, 300)
    (row,) = predict(tmp_path / "out", photo_file, "--mask-model", runs["mask"], "--px-per-mm", 5)
    assert row["method"] == "mask x given scale"
    assert float(row["area_cm2"]) == pytest.approx(np.pi * 90**2 / 25 / 100, rel=0.03)


def test_csv_cannot_be_run_by_a_spreadsheet(
    runs: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name = "=HYPERLINK(1),2.png"
    save(tmp_path / name, 96, 96)
    rows = predict(tmp_path / "out", name, "--model", runs["area"])
    with (tmp_path / "out" / "areas.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert rows[0]["photo"] == name and row["photo"] == f"'{name}"
    assert float(row["area_cm2"]) == pytest.approx(PERCENT, rel=0.03)
    assert (tmp_path / "out" / row["overlay"].removeprefix("'")).is_file()


def test_odd_names(runs: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["two\nlines.png", "\x1b[31mred.png", "blatt_ä_叶.png", "x" * 250 + ".png"]
    rows = predict(
        tmp_path / "out", *[save(tmp_path / name, 96, 96) for name in names], "--model", runs["area"]
    )
    assert [row["error"] for row in rows] == [None] * 4
    printed = capsys.readouterr().out
    assert "\x1b" not in printed and len(printed.splitlines()) == 5 and "blatt_ä_叶.png" in printed


def test_leaves_are_numbered_in_table_summary_and_overlay(
    runs: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = photo(300, 400)
    Image.fromarray(np.concatenate([one, one[::2, ::2].repeat(2, axis=0)], axis=1)).save(tmp_path / "two.png")
    rows = predict(tmp_path / "out", tmp_path / "two.png", "--model", runs["mask"], "--px-per-mm", 4)
    assert [row["leaf"] for row in rows] == [1, 2]
    # The second disk is half as wide.
    assert rows[1]["area_cm2"] == pytest.approx(float(str(rows[0]["area_cm2"])) / 2, rel=0.03)
    assert rows[0]["length_mm"] == pytest.approx(2 * 90 / 4, rel=0.02)
    assert rows[1]["width_mm"] == pytest.approx(90 / 4, rel=0.03)
    printed = capsys.readouterr().out
    assert "2 leaves" in printed and "leaf 2" in printed and "leaves measured: 2" in printed
    with (tmp_path / "out" / "areas.csv").open(newline="") as file:
        assert [row["leaf"] for row in csv.DictReader(file)] == ["1", "2"]
    overlay = np.asarray(Image.open(tmp_path / "out" / "two.overlay.jpg"))
    assert (overlay[:700] < 20).all(axis=2).sum() > 50, "no numbers on the leaves"


def test_numbers_have_as_many_digits_as_a_photo_gives() -> None:
    leaf = LeafMeasurement(area_cm2=100 / 3, uncertainty_cm2=1 / 3, px_per_mm=6.123456789012345)
    (record,) = make_records(
        "a.png", Measurement(method="one", leaves=(leaf,), tilt_deg=1 / 3), "a.overlay.jpg"
    )
    assert (record.area_cm2, record.px_per_mm, record.tilt_deg) == (33.33, 6.123, 0.3)
    assert record.uncertainty_cm2 == 0.33
