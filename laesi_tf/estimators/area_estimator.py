"""Measure a photo with the area network alone, as in the paper: it predicts cm2 from the whole photo."""

import math
from typing import NamedTuple

import keras
import numpy as np

from laesi_tf.common.arrays import RgbImage
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.models.area_network import to_area_cm2
from laesi_tf.models.inference import compile_inference

METHOD = "regression"


class AreaPrediction(NamedTuple):
    """What the area network predicts of a photo."""

    area_cm2: float
    """Area of one leaf; NaN where the network's output is not finite."""
    px_per_mm: float | None
    """Scale of the photo at the leaf; None from a network without this output."""


class AreaEstimator:
    """Measures with an area network; it makes no outline."""

    def __init__(self, model: keras.Model, input_size: tuple[int, int], transform: str) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> [B, n], whose first output is the transformed area.

        `input_size` is (height, width); `transform` is what training applied to the area.
        """
        self._input_size = input_size
        self._transform = transform
        self._predict = compile_inference(model, input_size)

    def predict_area(self, pyramid: PhotoPyramid) -> AreaPrediction:
        """Predict the area of the leaf on a photo and the photo's scale."""
        image, letterbox = pyramid.letterbox_overview(self._input_size)
        output = self._predict(image[np.newaxis])[0]
        area = float(to_area_cm2(output[0], self._transform))
        px_per_mm = math.nan
        if len(output) > 1:
            photo_px = pyramid.overview.pixel_size / letterbox.scale
            px_per_mm = float(np.exp(np.float64(output[1])) * photo_px[0])
        return AreaPrediction(area, px_per_mm if math.isfinite(px_per_mm) and px_per_mm > 0 else None)

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`, one leaf; `info` is not used."""
        area = self.predict_area(PhotoPyramid(image)).area_cm2
        if not math.isfinite(area):
            return Measurement(method=METHOD, refusal="the area model's output is not finite; train it again")
        return Measurement(method=METHOD, leaves=(LeafMeasurement(area_cm2=area),))
