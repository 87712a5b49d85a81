"""A mask network as an estimator without refinement, for the paper's mIoU and mask pixel error."""

import keras
import numpy as np

from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.estimators.base import UNKNOWN, Measurement, PhotoInfo
from laesi_tf.models.inference import compile_inference

METHOD = "mask network"


class MaskOnlyEstimator:
    """An estimator that gives a mask and refuses areas."""

    def __init__(self, model: keras.Model, size: tuple[int, int]) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> leaf probability [B, h, w, 1]; `size` is (h, w)."""
        self._size = size
        self._predict = compile_inference(model, size)

    def measure(self, image: np.ndarray, known: PhotoInfo = UNKNOWN) -> Measurement:
        """As `Estimator.measure`: leaf is where the network, stretched to the photo, says so by half."""
        small, placement = letterbox_image(image, self._size)
        leaf = placement.to_photo(self._predict(small[np.newaxis])[0, ..., 0])
        return Measurement(method=METHOD, mask=leaf >= 0.5, refusal="a mask alone has no scale")
