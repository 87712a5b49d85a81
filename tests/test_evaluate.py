"""Scores of an estimator whose results are known."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from green import disk, photo, save_run
from PIL import Image

from laesi_tf import evaluate as command
from laesi_tf.reporting.overlay import TRUE_COLOUR

pytestmark = pytest.mark.usefixtures("stand_in_networks")

# Output of the area network for `photo(96, 96)`, by construction.
PERCENT = 100 * math.pi * 0.3**2


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    return {task: save_run(folder / task, task, size=(96, 96)) for task in ("area", "mask")}


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    """Four photos of one leaf: correct, 50 % too small, on other paper without mask, and truncated."""
    for name in "abcd":
        Image.fromarray(photo(96, 96)).save(tmp_path / f"{name}.png")
        Image.fromarray(disk(96, 96)).save(tmp_path / f"{name}_mask.png")
    whole = (tmp_path / "d.png").read_bytes()
    (tmp_path / "d.png").write_bytes(whole[: len(whole) // 2])
    path = tmp_path / "manifest.csv"
    path.write_text(
        "image,area_cm2,mask,px_per_mm,grid_mm,subset,split\n"
        f"a.png,{PERCENT},a_mask.png,2,1,easy,test\n"
        f"b.png,{PERCENT * 2},b_mask.png,2,1,hard,test\n"
        f"c.png,{PERCENT},,,5,,test\n"
        f"d.png,{PERCENT},d_mask.png,2,1,easy,test\n"
    )
    return path


def run_on(manifest: Path, out: Path, *models: str) -> dict[str, dict[str, float | None]]:
    json_file = out.parent / f"{out.name}.json"
    command.main(["--photos", str(manifest), "--out", str(out), "--json", str(json_file), *models])
    return json.loads(json_file.read_text())


def test_metrics_of_each_subset(
    runs: dict[str, Path], manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run_on(
        manifest,
        tmp_path / "out",
        "--model",
        str(runs["area"]),
        "--mask-model",
        str(runs["mask"]),
        "--guess",
        "--split",
        "test",
    )
    assert list(found) == ["all", "easy", "hard", "grid 5 mm"]
    assert found["easy"]["mre"] == pytest.approx(0, abs=2) and found["hard"]["mre"] == pytest.approx(
        50, abs=2
    )
    assert found["all"]["mre"] == pytest.approx(50 / 3, abs=2)
    assert found["all"]["n"] == 3 and found["all"]["skipped"] == 1 and found["all"]["refused"] == 0
    assert found["easy"]["n"] == 1 and found["easy"]["skipped"] == 1
    assert found["easy"]["miou"] > 0.97 and found["easy"]["mpe"] < 0.03
    assert found["grid 5 mm"]["miou"] is None and found["grid 5 mm"]["mpe"] is None
    printed = capsys.readouterr().out
    assert "skipped d.png: " in printed


def test_files_of_a_run(runs: dict[str, Path], manifest: Path, tmp_path: Path) -> None:
    run_on(manifest, tmp_path / "out", "--model", str(runs["area"]))
    with (tmp_path / "out" / "photos.csv").open(newline="") as file:
        rows = {row["image"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["a.png", "b.png", "c.png", "d.png"]
    assert float(rows["b.png"]["relative_error_percent"]) == pytest.approx(-50, abs=2)
    assert rows["a.png"]["method"] == "regression" and rows["a.png"]["iou"] == ""
    assert "cannot be decoded" in rows["d.png"]["error"] and rows["d.png"]["predicted_cm2"] == ""
    for name in ("true_cm2", "predicted_cm2", "relative_error_percent"):
        assert len(rows["b.png"][name].lstrip("-").replace(".", "")) <= 5
    worst = np.asarray(Image.open(tmp_path / "out" / "worst.png"))
    assert worst.shape[1] > 3 * 400 and {tuple(pixel) for pixel in worst.reshape(-1, 3)} >= {TRUE_COLOUR}


def test_worst_tiles_have_a_legend(runs: dict[str, Path], manifest: Path, tmp_path: Path) -> None:
    run_on(manifest, tmp_path / "out", "--model", str(runs["area"]))
    worst = np.asarray(Image.open(tmp_path / "out" / "worst.png"))
    # A line of text below the tiles, and nothing else.
    legend = worst[-40:]
    assert (legend < 128).all(axis=2).sum() > 100 and (legend.min(axis=2) == legend.max(axis=2)).all()


def test_a_missing_photo_is_skipped(
    runs: dict[str, Path], manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "b.png").unlink()
    metrics = run_on(manifest, tmp_path / "out", "--model", str(runs["area"]))
    assert metrics["all"]["n"] == 2 and metrics["all"]["skipped"] == 2
    assert "skipped b.png: " in capsys.readouterr().out


def test_mask_model_needs_the_manifests_scale(
    runs: dict[str, Path], manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run_on(manifest, tmp_path / "out", "--model", str(runs["mask"]))
    area = math.pi * (0.3 * 96) ** 2 / 2**2 / 100
    assert found["easy"]["mre"] == pytest.approx(100 * (1 - area / PERCENT), abs=1)
    assert "photos by method:\n    3  mask x given scale\n" in capsys.readouterr().out
    assert found["grid 5 mm"]["refused"] == 1 and found["grid 5 mm"]["mre"] is None and found["all"]["n"] == 3
