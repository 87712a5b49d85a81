"""What `predict` writes beside areas.csv, and the options that say how."""

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measuring_folders import MeanLevel, names, predict, read_rows, save
from PIL import Image

from laesi_tf import predict as command
from laesi_tf.common.errors import InputError
from laesi_tf.data.file_resolution import read_dpi
from laesi_tf.estimators import factory
from laesi_tf.estimators.base import LeafMeasurement, Measurement
from laesi_tf.reporting.histogram import choose_edges, draw_histogram
from laesi_tf.reporting.leaf_records import COLUMNS
from laesi_tf.reporting.measurement_overlay import _number_leaves


@pytest.fixture(autouse=True)
def mean_level(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factory, "load_estimator", lambda *_, **__: MeanLevel())


def test_dialects_of_csv(tmp_path: Path) -> None:
    photo = save(tmp_path / "bäume.png", 50)
    predict(tmp_path / "1", photo)
    standard = (tmp_path / "1" / "areas.csv").read_bytes()
    assert standard.startswith(b"photo,sample,leaf,area_cm2")
    command.main([str(photo), "--out", str(tmp_path / "1"), "--csv", "excel"])
    assert (tmp_path / "1" / "areas.csv").read_bytes() == b"\xef\xbb\xbf" + standard
    command.main([str(photo), "--out", str(tmp_path / "1"), "--csv", "decimal-comma"])
    text = (tmp_path / "1" / "areas.csv").read_text(encoding="utf-8-sig")
    (row,) = csv.DictReader(text.splitlines(), delimiter=";")
    assert (
        row["area_cm2"] == "50,0" and row["uncertainty_cm2"] == "0,5" and row["photo"].endswith("bäume.png")
    )
    command.main([str(photo), "--out", str(tmp_path / "1"), "--csv", "standard"])
    assert (tmp_path / "1" / "areas.csv").read_bytes() == standard


def test_a_folder_keeps_its_dialect(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two = save(tmp_path / "1.png", 50), save(tmp_path / "2.png", 60)
    table = tmp_path / "out" / "areas.csv"
    kept = "as in earlier commands: --csv decimal-comma\n"
    command.main([str(one), "--out", str(table.parent), "--csv", "decimal-comma"])
    assert kept not in capsys.readouterr().out
    command.main([str(two), "--out", str(table.parent)])
    assert [line.count(b";") for line in table.read_bytes().splitlines()] == [len(COLUMNS) - 1] * 3
    assert kept in capsys.readouterr().out
    for _ in range(2):
        command.main([str(two), "--out", str(table.parent), "--csv", "standard"])
        assert table.read_bytes().startswith(b"photo,sample")
        assert "as in earlier commands" not in capsys.readouterr().out


def test_json_lines_have_the_same_figures(tmp_path: Path) -> None:
    for level in (10, 20):
        save(tmp_path / "in" / f"{level}.png", level)
    predict(tmp_path / "out", tmp_path / "in", "--jsonl", tmp_path / "a.jsonl", "--json", tmp_path / "a.json")
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert lines == json.loads((tmp_path / "a.json").read_text())
    assert [line["area_cm2"] for line in lines] == [10, 20] and tuple(lines[0]) == COLUMNS


def test_provenance_says_what_an_area_depends_on(tmp_path: Path) -> None:
    predict(tmp_path / "out", save(tmp_path / "a.png"), "--grid-mm", 5)
    provenance = json.loads((tmp_path / "out" / "areas.provenance.json").read_text())
    settings = provenance["settings"]
    assert settings["grid_mm"] == 5 and set(settings["models"]) == {"mask", "ruling"}
    assert all(re.fullmatch("[0-9a-f]{16}", digest) for digest in settings["models"].values())
    assert provenance["photos"] == 1 and provenance["packages"]["tensorflow"]


def test_names_are_joined_and_mismatches_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("A/1.png", "B/1.png", "B/2.png", "B/3.png"):
        save(tmp_path / "in" / name)
    (tmp_path / "n.csv").write_text(
        "\ufeffFile;Sample\nA\\1.png;oak\nB/1.PNG;birch\n2.png;fir\n9.png;ash\n", "utf-8"
    )
    rows = predict(tmp_path / "out", tmp_path / "in", "--recursive", "--names", tmp_path / "n.csv")
    assert [row["sample"] for row in rows] == ["oak", "birch", "fir", ""]
    printed = capsys.readouterr().out
    assert "names without a photo: 1 (9.png)" in printed and "photos without a name: 1 (" in printed
    (tmp_path / "n.csv").write_text("1.png,oak\n")
    with pytest.raises(InputError, match=r"1\.png is both .*A/1\.png and .*B/1\.png; write its folder"):
        predict(tmp_path / "out", tmp_path / "in", "--recursive", "--names", tmp_path / "n.csv")


def samples(rows: list[dict[str, str]]) -> dict[str, str]:
    """Return the sample of each photo, by its folder and name."""
    return {"/".join(Path(row["photo"]).parts[-2:]): row["sample"] for row in rows}


def test_a_folder_keeps_its_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("A/1.png", "A/2.png", "B/1.png", "B/3.png"):
        save(tmp_path / name)
    listed, out = tmp_path / "n.csv", tmp_path / "out"
    listed.write_text("1.png,oak\n2.png,fir\n3.png,ash\n")
    predict(out, tmp_path / "A", "--names", listed)
    capsys.readouterr()
    # The row of 3.png finds its photo now; that of 1.png is the one of A, and no other.
    rows = predict(out, tmp_path / "B")
    assert samples(rows) == {"A/1.png": "oak", "A/2.png": "fir", "B/1.png": "", "B/3.png": "ash"}
    printed = capsys.readouterr().out
    assert f"as in earlier commands: --names {listed}\n" in printed and "has changed" not in printed
    assert "photos without a name: 1 (" in printed and "names without a photo" not in printed
    listed.write_text("1.png,birch\n")
    assert samples(predict(out, tmp_path / "A"))["A/1.png"] == "oak"
    assert f"{listed} has changed since; name it with --names" in capsys.readouterr().out
    listed.unlink()
    assert samples(predict(out, tmp_path / "A"))["A/1.png"] == "oak"
    assert "has changed" not in capsys.readouterr().out


def test_another_list_replaces_the_names_of_its_command(tmp_path: Path) -> None:
    for name in ("A/1.png", "A/2.png", "B/1.png", "B/2.png"):
        save(tmp_path / name)
    listed, out = tmp_path / "n.csv", tmp_path / "out"
    listed.write_text("1.png,oak\n2.png,fir\n")
    predict(out, tmp_path / "A", "--names", listed)
    listed.write_text("1.png,birch\n")
    expected = {"A/1.png": "oak", "A/2.png": "fir", "B/1.png": "birch", "B/2.png": ""}
    assert samples(predict(out, tmp_path / "B", "--names", listed)) == expected
    assert samples(predict(out, tmp_path / "A")) == expected
    listed.write_text("file,sample\n")
    rows = predict(out, tmp_path / "A", "--names", listed)
    assert samples(rows) == expected | {"A/1.png": "", "A/2.png": ""}


def test_a_list_that_is_given_again_keeps_what_its_rows_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two, other = (save(tmp_path / name) for name in ("A/1.png", "A/2.png", "B/1.png"))
    (tmp_path / "n.csv").write_text("1.png,oak\n2.png,fir\n")
    for photo in (one, two):
        predict(tmp_path / "out", photo, "--names", tmp_path / "n.csv")
    first, second = capsys.readouterr().out.split("see ")[1:]
    assert "names without a photo: 1 (2.png)" in first and "names without" not in second
    rows = predict(tmp_path / "out", other)
    assert samples(rows) == {"A/1.png": "oak", "A/2.png": "fir", "B/1.png": ""}


def test_kept_names_are_refused_where_they_are_ambiguous(tmp_path: Path) -> None:
    for name in ("1.png", "A/2.png", "B/2.png"):
        save(tmp_path / name)
    (tmp_path / "n.csv").write_text("1.png,oak\n2.png,fir\n")
    predict(tmp_path / "out", tmp_path / "1.png", "--names", tmp_path / "n.csv")
    with pytest.raises(InputError, match=r"2\.png is both .* and give the list again with --names"):
        predict(tmp_path / "out", tmp_path / "A", tmp_path / "B")


def test_a_kept_name_of_a_file_is_that_of_its_pages(tmp_path: Path) -> None:
    scan, listed = save(tmp_path / "scan.tif"), tmp_path / "n.csv"
    listed.write_text("scan.tif,oak\n")
    predict(tmp_path / "out", scan, "--names", listed)
    page = Image.new("RGB", (40, 30), (70, 70, 70))
    page.save(scan, save_all=True, append_images=[page])
    assert [row["sample"] for row in predict(tmp_path / "out", scan)] == ["oak"] * 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no rows"),
        ("file,sample\na.png\n", "row 2: "),
        ("a.png,1\na.png,2\n", "has the samples 1 and 2"),
        ("a.png,,3\n", "row 1: "),
    ],
)
def test_broken_lists_of_names(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "n.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        predict(tmp_path / "out", save(tmp_path / "a.png"), "--names", tmp_path / "n.csv")
    assert not (tmp_path / "out").exists()


def test_overlays_can_be_left_out_and_made_later_at_another_size(tmp_path: Path) -> None:
    save(tmp_path / "in" / "a.png")
    rows = predict(tmp_path / "out", tmp_path / "in", "--no-overlay")
    assert rows[0]["overlay"] == "" and not list((tmp_path / "out").glob("*.png"))
    for options, side in (((), 800), (("--overlay-size", 400), 400)):
        rows = predict(tmp_path / "out", tmp_path / "in", *options)
        assert Image.open(tmp_path / "out" / rows[0]["overlay"]).width == side
    with pytest.raises(InputError, match="--overlay-size has no effect with --no-overlay"):
        predict(tmp_path / "out", tmp_path / "in", "--no-overlay", "--overlay-size", 400)


def test_overlays_of_photos_alike_in_their_first_50_letters(tmp_path: Path) -> None:
    for ending in ("one", "two"):
        save(tmp_path / "in" / f"{'x' * 60}{ending}.png")
    both = {row["photo"]: row["overlay"] for row in predict(tmp_path / "1", tmp_path / "in")}
    assert len(set(both.values())) == 2 and not any("-2." in name for name in both.values())
    last = max(both)
    (row,) = predict(tmp_path / "2", last)
    assert row["overlay"] == both[last]


def test_many_unreadable_files_are_summarised(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(300):
        (tmp_path / f"in{number:03}.png").write_bytes(b"no image %d" % number)
    save(tmp_path / "leaf.png", 70)
    rows = predict(tmp_path / "out", tmp_path)
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 2 and printed[0].startswith(
        "300 without an area: is not an image in a known format"
    )
    assert "and 297 more" in printed[0] and "skipped: 300" in printed[1]
    assert len(rows) == 301


def test_the_page_is_self_contained_and_safe(tmp_path: Path) -> None:
    save(tmp_path / "in" / "<b>a.png", 50)
    save(tmp_path / "in" / "black.png", 0)
    (tmp_path / "in" / "notes.txt").write_text("no photo")
    save(tmp_path / "in" / "c.png", 90)
    predict(tmp_path / "out", tmp_path / "in")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;a.png" in page and "<b>a.png" not in page
    assert page.count("data:image/jpeg;base64,") == 3 and "<svg" in page
    assert "it is black" in page and "Passed over: 1 file that is no photo" in page
    assert not re.search(r'(src|href)="(?!data:)', page) and "<script" not in page


@given(st.lists(st.floats(1e-3, 1e4), min_size=1, max_size=50))
def test_histograms_hold_all_areas(areas: list[float]) -> None:
    edges = choose_edges(areas)
    assert edges[0] <= min(areas) and edges[-1] > max(areas) * (1 - 1e-12) and 2 <= len(edges) <= 60
    counted = re.findall(r"cm²: (\d+)</title>", draw_histogram(areas))
    assert sum(map(int, counted)) == len(areas)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--px-per-mm", "5", "--dpi", "300"], "both give the scale"),
        (["--px-per-mm", "5", "--grid-mm", "2"], "--grid-mm has no effect with --px-per-mm"),
        (["--dpi", "300", "--guess"], "--guess has no effect with --dpi"),
        (["--dpi", "file", "--ruling-model", "x"], "--ruling-model has no effect with --dpi"),
        (["--model", "rule_based", "--grid-mm", "2"], "--grid-mm has no effect with --model rule_based"),
        (["--dpi", "0"], "--dpi"),
        (["--overlay-size", "5"], "from 200 to 20000"),
        (["--workers", "0"], "--workers"),
    ],
)
def test_options_without_effect_are_errors(options: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        predict(tmp_path / "out", save(tmp_path / "a.png"), *options)
    assert not (tmp_path / "out").exists()


def test_resolutions_of_files(tmp_path: Path) -> None:
    for name in ("a.tif", "a.jpg", "a.png", "a.bmp"):
        assert read_dpi(save(tmp_path / name, dpi=(300, 300))) == 300
    for dpi, message in [
        ((72, 72), "states 72 dpi, which programs write by default"),
        ((96, 96), "states 96 dpi"),
        ((300, 600), "300 dpi across and 600 dpi down"),
        (None, "states no resolution; give the scanner's with --dpi N"),
    ]:
        options = {} if dpi is None else {"dpi": dpi}
        with pytest.raises(InputError, match=message):
            read_dpi(save(tmp_path / "b.jpg", **options))
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x920A] = 4.2
    with pytest.raises(InputError, match="is a camera's photo: its 300 dpi say nothing of its scale"):
        read_dpi(save(tmp_path / "c.jpg", dpi=(300, 300), exif=exif))


def test_dpi_of_each_file_is_its_scale(tmp_path: Path) -> None:
    for name, dpi in (("a.tif", 300), ("b.tif", 254), ("c.tif", 72)):
        save(tmp_path / "in" / name, dpi=(dpi, dpi))
    rows = predict(tmp_path / "out", tmp_path / "in", "--dpi", "file")
    assert [row["px_per_mm"] for row in rows] == ["11.81", "10.0", ""]
    assert rows[2]["refused"] == "True" and "72 dpi" in rows[2]["error"]
    rows = predict(tmp_path / "2", tmp_path / "in", "--dpi", "600")
    assert {row["px_per_mm"] for row in rows} == {"23.62"}
    assert names(rows) == names(read_rows(tmp_path / "out"))


def test_many_leaves_are_labelled_by_their_numbers_alone() -> None:
    corners = np.array([[0.0, 0], [30, 0], [30, 50], [0, 50]])
    leaves = [LeafMeasurement(area_cm2=1.5, outline=corners + 100 * number) for number in range(30)]
    few, many = (Measurement(method="m", leaves=tuple(leaves[:count])) for count in (2, 30))
    labels, height = _number_leaves(few, np.ones(2))
    assert [text for _, text in labels] == ["1: 1.50", "2: 1.50"] and height == math.inf
    labels, height = _number_leaves(many, np.ones(2))
    assert [text for _, text in labels] == [str(number) for number in range(1, 31)] and height == 12
