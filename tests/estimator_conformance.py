"""Conformance suite: the contract of every estimator.

A test class inherits from `EstimatorConformance` and defines a fixture `estimator`.
"""

import math

import numpy as np
import pytest
from green import photo

from laesi_tf.estimators.base import Estimator, Measurement, PhotoInfo

SIZES = {"square": (300, 300), "portrait": (400, 300), "landscape": (300, 400), "strip": (24, 900)}
EXTREMES = {
    "one pixel": np.full((1, 1, 3), 120, np.uint8),
    "one row": np.full((1, 500, 3), 200, np.uint8),
    "black": np.zeros((200, 300, 3), np.uint8),
    "white": np.full((200, 300, 3), 255, np.uint8),
    "grey leaf": np.repeat(photo(300, 200).mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8),
    "noise": np.random.default_rng(0).integers(0, 256, (200, 300, 3), np.uint8),
    "huge": np.repeat(np.repeat(photo(300, 400), 10, axis=0), 10, axis=1),
}
INFOS = (PhotoInfo(), PhotoInfo(px_per_mm=5.0), PhotoInfo(px_per_mm=5.0, grid_mm=5.0))


def check_measurement(measurement: Measurement, image: np.ndarray) -> None:
    """Assert that a measurement is finite or refused, and lies within its photo."""
    assert measurement.method
    if measurement.refusal is None:
        assert measurement.leaves
    for leaf in measurement.leaves:
        if measurement.refusal is not None:
            assert leaf.area_cm2 is None
        else:
            assert leaf.area_cm2 is not None and math.isfinite(leaf.area_cm2) and leaf.area_cm2 > 0
        if leaf.outline is not None:
            _check_outline(leaf.outline, image)
        sizes = (leaf.px_per_mm, leaf.uncertainty_cm2, leaf.length_mm, leaf.width_mm, leaf.perimeter_mm)
        for value in sizes:
            assert value is None or (math.isfinite(value) and value > 0)
        assert leaf.holes_cm2 is None or 0 <= leaf.holes_cm2 < math.inf
        if leaf.length_mm is not None and leaf.perimeter_mm is not None:
            assert leaf.perimeter_mm >= 1.9 * leaf.length_mm
    assert measurement.tilt_deg is None or 0 <= measurement.tilt_deg < 90
    if measurement.mask is not None:
        assert measurement.mask.dtype == bool and measurement.mask.shape == image.shape[:2]


def _check_outline(outline: np.ndarray, image: np.ndarray) -> None:
    assert outline.ndim == 2 and outline.shape[1] == 2
    assert (outline >= 0).all() and (outline <= image.shape[1::-1]).all()


def is_same(first: Measurement, second: Measurement) -> bool:
    """Return whether two measurements agree to the last bit."""
    leaves = zip(first.leaves, second.leaves, strict=True)
    return (
        (first.method, first.refusal, first.area_cm2) == (second.method, second.refusal, second.area_cm2)
        and all(
            np.array_equal(one.outline, other.outline) for one, other in leaves if one.outline is not None
        )
        and (first.mask is None or np.array_equal(first.mask, second.mask))
    )


class EstimatorConformance:
    """The suite; each test gets a fresh photo."""

    @pytest.mark.parametrize("info", INFOS)
    @pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
    def test_any_shape_is_measured_or_refused(
        self, estimator: Estimator, size: tuple[int, int], info: PhotoInfo
    ) -> None:
        image = photo(*size)
        check_measurement(estimator.measure(image, info), image)

    @pytest.mark.parametrize("image", EXTREMES.values(), ids=EXTREMES)
    def test_extremes_are_measured_or_refused(self, estimator: Estimator, image: np.ndarray) -> None:
        check_measurement(estimator.measure(image, PhotoInfo(px_per_mm=5.0)), image)

    def test_measurement_does_not_depend_on_earlier_photos(self, estimator: Estimator) -> None:
        first = estimator.measure(photo(300, 400))
        estimator.measure(photo(500, 200, radius=0.1))
        assert is_same(first, estimator.measure(photo(300, 400)))

    def test_photo_is_not_changed(self, estimator: Estimator) -> None:
        image = photo(300, 400)
        image.flags.writeable = False
        estimator.measure(image)
        assert np.array_equal(image, photo(300, 400))

    def test_memory_layout_does_not_matter(self, estimator: Estimator) -> None:
        image = photo(300, 400)
        assert is_same(estimator.measure(image), estimator.measure(np.asfortranarray(image)))
