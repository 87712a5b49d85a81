"""The paper's way: a network looks at the whole photo and says how many cm2 of leaf there are."""

import math

import keras
import numpy as np

from laesi_tf.data.fitting import fit
from laesi_tf.estimators.base import NOTHING, Known, Leaf, Measurement
from laesi_tf.estimators.network import compiled
from laesi_tf.models.area import to_area_cm2

METHOD = "regression"


class Regression:
    """The area network of a run; it makes no outline."""

    def __init__(self, model: keras.Model, size: tuple[int, int], transform: str) -> None:
        """Take a model [1, h, w, 3] in 0..255 -> [1, n], transformed area first; `size` is (h, w)."""
        self._size = size
        self._transform = transform
        self._predict = compiled(model, size)

    def px_per_mm(self, image: np.ndarray) -> float | None:
        """The network's own idea of the photo's scale at the leaf; None from a network that has none."""
        small, placement = fit(image, self._size)
        output = self._predict(small)
        scale = math.exp(output[1]) / placement.scale[0] if len(output) > 1 else math.nan
        return scale if math.isfinite(scale) and scale > 0 else None

    def measure(self, image: np.ndarray, known: Known = NOTHING) -> Measurement:
        """As `Estimator.measure`, for one leaf."""
        small, _ = fit(image, self._size)
        area = float(to_area_cm2(self._predict(small)[0], self._transform))
        if not math.isfinite(area):
            return Measurement(method=METHOD, refusal="the area model gives no number; train it again")
        return Measurement(method=METHOD, leaves=(Leaf(area_cm2=area),))
