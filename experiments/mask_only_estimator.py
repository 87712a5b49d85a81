"""A mask network as an estimator without refinement, for the paper's mIoU and mask pixel error.

The mask estimator that measures photos zooms in on leaves and refines their edges, which would hide what a
network has learned.
"""

import keras
import numpy as np

from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.estimators.base import UNKNOWN, Measurement, PhotoInfo
from laesi_tf.models.inference import compile_inference

METHOD = "mask network"


class MaskOnlyEstimator:
    """An estimator that returns a mask and refuses to give an area."""

    def __init__(self, model: keras.Model, size: tuple[int, int]) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> leaf probability [B, h, w, 1]; `size` is (h, w)."""
        self._size = size
        self._predict = compile_inference(model, size)

    def measure(self, image: np.ndarray, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Implement `Estimator.measure`: the mask is where the network's probability is at least one half."""
        small, letterbox = letterbox_image(image, self._size)
        probability = letterbox.crop_and_resize_back(self._predict(small[np.newaxis])[0, ..., 0])
        return Measurement(method=METHOD, mask=probability >= 0.5, refusal="a mask alone has no scale")
