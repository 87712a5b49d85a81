"""Scores of estimators whose results are known."""

from pathlib import Path

import numpy as np
import pytest
from green import disk, photo
from PIL import Image

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


def test_coverage_and_areas_that_are_far_off() -> None:
    scores = [
        PhotoScore(photo=photo_of(10.0), predicted_cm2=predicted, uncertainty_cm2=0.5)
        for predicted in (10.4, 9.2, 10.9, 11.2)
    ]
    scores.append(PhotoScore(photo=photo_of(10.0), predicted_cm2=10.0))
    scores.append(PhotoScore(photo=photo_of(10.0), refusal="no grid"))
    metrics = summarise(scores)
    # Only photos with an uncertainty count towards its coverage.
    assert (metrics["within_1_sd"], metrics["within_2_sd"]) == (0.25, 0.75)
    assert metrics["silent_errors"] == 1


def test_errors_of_the_scale_are_those_of_photos_whose_ruling_was_read() -> None:
    scores = [PhotoScore(photo=photo_of(1.0), scale_error=error) for error in (-0.3, 0.1, None, 0.2)]
    metrics = summarise(scores)
    assert metrics["scale_median"] == pytest.approx(0.2) and metrics["scale_p90"] == pytest.approx(0.28)
    assert summarise([PhotoScore(photo=photo_of(1.0))])["scale_median"] is None


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


def test_a_leaf_that_was_not_found_has_no_overlap(tmp_path: Path) -> None:
    Image.fromarray(photo(96, 96)).save(tmp_path / "a.png")
    Image.fromarray(disk(96, 96)).save(tmp_path / "a_mask.png")

    class Blind:
        def measure(self, image: np.ndarray, info: PhotoInfo = UNKNOWN) -> Measurement:
            return Measurement(method="blind", mask=np.zeros(image.shape[:2], bool), refusal="no leaf found")

    mask = tmp_path / "a_mask.png"
    one = Photo(name="a.png", image=tmp_path / "a.png", area_cm2=1.0, mask=mask)
    metrics = summarise(score_photos(Blind(), [one]))
    assert metrics["miou"] == 0.0 and metrics["mpe"] == 1.0 and metrics["refused"] == 1


def test_every_leaf_counts_towards_the_area() -> None:
    leaves = (LeafMeasurement(area_cm2=2.0), LeafMeasurement(area_cm2=3.0))
    assert Measurement(method="two", leaves=leaves).area_cm2 == 5.0
    assert Measurement(method="two", leaves=leaves, refusal="tilted").area_cm2 is None
