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
from laesi_tf.data.manifest import Photo
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.evaluation.photo_scores import (
    PhotoScore,
    bootstrap_interval,
    group_by_subset,
    score_photos,
    sort_worst_first,
    summarise,
)
from laesi_tf.reporting.captions import add_caption, make_contact_sheet
from laesi_tf.reporting.overlay import TRUE_COLOUR, draw_outlines

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
    command.main(["--photos", str(manifest), "--out", str(out), "--json", str(out / "all.json"), *models])
    return json.loads((out / "all.json").read_text())


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
        "--split",
        "test",
    )
    assert list(found) == ["all", "easy", "hard", "grid 5 mm"]
    assert found["easy"]["mre"] == pytest.approx(0, abs=2) and found["hard"]["mre"] == pytest.approx(
        50, abs=2
    )
    # On other paper the area network does not stand in for the ruling: that photo is refused.
    assert found["all"]["mre"] == pytest.approx(25, abs=2) and found["grid 5 mm"]["mre"] is None
    assert found["all"]["n"] == 3 and found["all"]["skipped"] == 1 and found["all"]["refused"] == 1
    assert found["all"]["refused_share"] == pytest.approx(1 / 3)
    assert found["easy"]["n"] == 1 and found["easy"]["skipped"] == 1
    assert found["easy"]["miou"] > 0.97 and found["easy"]["mpe"] < 0.03
    assert found["grid 5 mm"]["miou"] is None and found["grid 5 mm"]["mpe"] is None
    printed = capsys.readouterr().out
    assert "1 of 4 photos are not on 1 mm paper" in printed and "skipped d.png: " in printed


def test_files_of_a_run(runs: dict[str, Path], manifest: Path, tmp_path: Path) -> None:
    run_on(manifest, tmp_path / "out", "--model", str(runs["area"]))
    with (tmp_path / "out" / "photos.csv").open(newline="") as file:
        rows = {row["image"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["a.png", "b.png", "c.png", "d.png"]
    assert float(rows["b.png"]["relative_error_percent"]) == pytest.approx(-50, abs=2)
    assert rows["a.png"]["method"] == "regression" and rows["a.png"]["iou"] == ""
    assert "cannot be decoded" in rows["d.png"]["error"] and rows["d.png"]["predicted_cm2"] == ""
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


def photo_of(area_cm2: float, **fields: object) -> Photo:
    return Photo(name="a.png", image=Path("a.png"), area_cm2=area_cm2, **fields)  # type: ignore[arg-type]


def test_metrics_against_numbers_by_hand() -> None:
    scores = [
        PhotoScore(photo=photo_of(10.0), predicted_cm2=predicted) for predicted in (9.0, 12.0, 10.0, 15.0)
    ]
    scores.append(PhotoScore(photo=photo_of(10.0), refusal="no grid"))
    metrics = summarise(scores)
    assert metrics["mre"] == pytest.approx((10 + 20 + 0 + 50) / 4) and metrics["median"] == pytest.approx(15)
    assert metrics["p90"] == pytest.approx(41) and metrics["n"] == 5 and metrics["refused"] == 1
    assert metrics["mre_low"] <= metrics["mre"] <= metrics["mre_high"]  # type: ignore[operator]
    assert [score.predicted_cm2 for score in sort_worst_first(scores)] == [15.0, 12.0, 9.0, 10.0]


def test_without_measured_photos_there_are_no_metrics() -> None:
    metrics = summarise(
        [PhotoScore(photo=photo_of(1.0), error="cut"), PhotoScore(photo=photo_of(1.0), refusal="no grid")]
    )
    assert metrics["n"] == 1 and metrics["skipped"] == 1
    assert all(metrics[key] is None for key in ("mre", "mre_low", "median", "p90", "miou", "mpe"))


def test_bootstrap_interval_covers_the_mean_and_narrows() -> None:
    errors = np.random.default_rng(1).exponential(5.0, 400)
    low, high = bootstrap_interval(errors)
    assert low < errors.mean() < high and bootstrap_interval(errors) == (low, high)
    # Four times the standard error of the mean, about.
    assert high - low == pytest.approx(3.92 * errors.std() / 20, rel=0.15)
    assert bootstrap_interval(np.array([7.0])) == (7.0, 7.0)


def test_subset_named_all_does_not_hide_the_others() -> None:
    scores = [PhotoScore(photo=photo_of(1.0, subset="all")), PhotoScore(photo=photo_of(1.0))]
    assert group_by_subset(scores) == {"all": scores}


def test_a_leaf_that_was_not_found_has_no_overlap(manifest: Path) -> None:
    class Blind:
        def measure(self, image: np.ndarray, info: PhotoInfo = UNKNOWN) -> Measurement:
            return Measurement(method="blind", mask=np.zeros(image.shape[:2], bool), refusal="no leaf found")

    mask = manifest.parent / "a_mask.png"
    one = Photo(name="a.png", image=manifest.parent / "a.png", area_cm2=1.0, mask=mask)
    metrics = summarise(score_photos(Blind(), [one]))
    assert metrics["miou"] == 0.0 and metrics["mpe"] == 1.0 and metrics["refused"] == 1


def test_every_leaf_counts_towards_the_area() -> None:
    leaves = (LeafMeasurement(area_cm2=2.0), LeafMeasurement(area_cm2=3.0))
    assert Measurement(method="two", leaves=leaves).area_cm2 == 5.0
    assert Measurement(method="two", leaves=leaves, refusal="tilted").area_cm2 is None


def test_outline_is_drawn_where_the_leaf_is() -> None:
    image = np.zeros((300, 400, 3), np.uint8)
    square = np.array([[100.0, 100.0], [300.0, 100.0], [300.0, 200.0], [100.0, 200.0]])
    drawn = draw_outlines(image, [(square, (255, 0, 160))])
    rows, columns = np.nonzero(drawn[..., 0] > 100)
    # A line one pixel wide on the border between two pixels covers both.
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == pytest.approx(
        (99.5, 199.5, 99.5, 299.5), abs=1
    )
    assert not image.any()


def test_caption_is_readable_and_hides_nothing() -> None:
    image = np.full((300, 400, 3), 90, np.uint8)
    framed = add_caption(image, ["31.25 cm²", "a long name " * 20])
    assert np.array_equal(framed[:300], image)
    assert framed.shape[0] > 330 and (framed[300:] < 128).any(axis=2).sum() > 100
    assert (framed[300:, -3:] == 255).all(), "the long line runs out of the picture"


def test_contact_sheet_holds_images_of_any_size() -> None:
    pictures = [np.full((height, 50, 3), shade, np.uint8) for height, shade in [(40, 10), (60, 20), (50, 30)]]
    page = make_contact_sheet(pictures, columns=2, gap=5)
    assert page.shape == (2 * 65 + 5, 2 * 55 + 5, 3)
    assert [(page == picture[0, 0]).all(axis=2).sum() for picture in pictures] == [2000, 3000, 2500]
