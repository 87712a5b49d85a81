"""Measure a photo with the area network alone, as in the paper: it predicts cm2 from the whole photo."""

import math
from typing import NamedTuple

import keras
import numpy as np

from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.models.area_network import to_area_cm2
from laesi_tf.models.inference import compile_inference

METHOD = "regression"


class AreaPrediction(NamedTuple):
    """What the area network says of a photo."""

    area_cm2: float
    """Of one leaf; NaN from a network that gives no number."""
    px_per_mm: float | None
    """Scale of the photo at the leaf; None from a network that has no idea of it."""


class AreaEstimator:
    """The area network of a run; it makes no outline."""

    def __init__(self, model: keras.Model, size: tuple[int, int], transform: str) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> [B, n], transformed area first; `size` is (h, w)."""
        self._size = size
        self._transform = transform
        self._predict = compile_inference(model, size)

    def guess(self, views: PhotoPyramid) -> AreaPrediction:
        """The network's own idea of the area of the leaf on a photo and of the photo's scale."""
        small, placement = views.fitted(self._size)
        output = self._predict(small[np.newaxis])[0]
        area = float(to_area_cm2(output[0], self._transform))
        scale = math.nan
        if len(output) > 1:
            scale = math.exp(output[1]) / placement.scale[0] * float(views.whole.step[0])
        return AreaPrediction(area, scale if math.isfinite(scale) and scale > 0 else None)

    def measure(self, image: np.ndarray, known: PhotoInfo = UNKNOWN) -> Measurement:
        """As `Estimator.measure`, for one leaf."""
        area = self.guess(PhotoPyramid(image)).area_cm2
        if not math.isfinite(area):
            return Measurement(method=METHOD, refusal="the area model gives no number; train it again")
        return Measurement(method=METHOD, leaves=(LeafMeasurement(area_cm2=area),))
