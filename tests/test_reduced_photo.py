"""An estimator that sees a smaller photo reports what it finds in photo pixels."""

import numpy as np
import pytest
from estimator_conformance import EstimatorConformance
from green import disk, photo

from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.estimators.easy_leaf_area import EasyLeafArea
from laesi_tf.estimators.reduced_photo import ReducedPhoto


class TestReducedPhoto(EstimatorConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def estimator(cls) -> Estimator:
        return ReducedPhoto(EasyLeafArea(), 150)


def test_outline_mask_and_scale_are_those_of_the_photo() -> None:
    image, info = photo(1200, 1600), PhotoInfo(px_per_mm=8.0)
    measured = ReducedPhoto(EasyLeafArea(), 400).measure(image, info)
    assert measured.area_cm2 == pytest.approx(EasyLeafArea().measure(image, info).area_cm2, rel=0.02)
    (leaf,) = measured.leaves
    assert leaf.px_per_mm == pytest.approx(8.0) and leaf.outline is not None
    np.testing.assert_allclose(np.ptp(leaf.outline, axis=0), 2 * 0.3 * 1200, rtol=0.02)
    assert measured.mask is not None
    assert (measured.mask != disk(1200, 1600)).mean() < 0.005


def test_a_small_photo_is_measured_as_it_is() -> None:
    image, info = photo(300, 300), PhotoInfo(px_per_mm=5.0)
    assert (
        ReducedPhoto(EasyLeafArea(), 400).measure(image, info).area_cm2
        == EasyLeafArea().measure(image, info).area_cm2
    )
