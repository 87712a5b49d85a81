"""The colour threshold on disks of known area."""

import math

import numpy as np
import pytest
from estimator_conformance import EstimatorConformance
from green import photo
from hypothesis import given, settings
from hypothesis import strategies as st

from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.estimators.colour_threshold import ColourThreshold, compute_excess_green
from laesi_tf.estimators.factory import load_estimator


class TestColourThreshold(EstimatorConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def estimator(cls) -> Estimator:
        return ColourThreshold()


@settings(max_examples=20)
@given(radius=st.floats(0.1, 0.45), px_per_mm=st.floats(1, 20))
def test_area_is_green_pixels_over_the_square_of_the_scale(radius: float, px_per_mm: float) -> None:
    measured = ColourThreshold().measure(photo(300, 400, radius=radius), PhotoInfo(px_per_mm=px_per_mm))
    true = math.pi * (300 * radius / px_per_mm) ** 2 / 100
    assert measured.area_cm2 == pytest.approx(true, rel=0.03)


def test_excess_green_is_the_formula_and_finite_on_black() -> None:
    image = np.array([[[10, 30, 20], [0, 0, 0], [255, 255, 255]]], np.uint8)
    expected = [(2 * 30 - 10 - 20) / 60, 0.0, 0.0]
    np.testing.assert_allclose(compute_excess_green(image)[0], expected, atol=1e-6)


def test_without_a_scale_it_refuses() -> None:
    refused = load_estimator("excess_green").measure(photo(100, 100))
    assert refused.area_cm2 is None and "--px-per-mm" in str(refused.refusal)
