"""Measure a photo with the area network alone, as in the paper: it predicts cm2 from the whole photo."""

import math
from collections.abc import Callable
from typing import NamedTuple

from laesi_tf.common.arrays import RgbImage
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.photo_pyramid import PhotoPyramid

METHOD = "regression"

AreaPredictor = Callable[[RgbImage], tuple[float, float]]
"""An area network: uint8 [h, w, 3] -> area of one leaf, cm2, and scale at the leaf, pixels of the image per
mm; NaN where an output is not finite or missing."""


class AreaPrediction(NamedTuple):
    """What the area network predicts of a photo."""

    area_cm2: float
    """Area of one leaf; NaN where the network's output is not finite."""
    px_per_mm: float | None
    """Scale of the photo at the leaf; None from a network without this output."""


class AreaEstimator:
    """Measures with an area network; it makes no outline."""

    def __init__(self, predict: AreaPredictor, input_size: tuple[int, int]) -> None:
        """Take an area network and the (height, width) of its input."""
        self._predict = predict
        self._input_size = input_size

    def predict_area(self, pyramid: PhotoPyramid) -> AreaPrediction:
        """Predict the area of the leaf on a photo and the photo's scale."""
        image, letterbox = pyramid.letterbox_overview(self._input_size)
        area, px_per_mm = self._predict(image)
        px_per_mm *= float(pyramid.overview.pixel_size[0] / letterbox.scale[0])
        return AreaPrediction(area, px_per_mm if math.isfinite(px_per_mm) and px_per_mm > 0 else None)

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`, one leaf; `info` is not used."""
        area = self.predict_area(PhotoPyramid(image)).area_cm2
        if not math.isfinite(area):
            return Measurement(method=METHOD, refusal="the area model's output is not finite; train it again")
        return Measurement(method=METHOD, leaves=(LeafMeasurement(area_cm2=area),))
