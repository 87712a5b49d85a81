"""The paper's way: a network looks at the whole photo and says how many cm2 of leaf there are."""

import math

import keras
import numpy as np

from laesi_tf.data.fitting import fit
from laesi_tf.estimators.base import NOTHING, Known, Leaf, Measurement, trace
from laesi_tf.estimators.network import compiled
from laesi_tf.estimators.segmentation import NO_LEAF, Segmentation
from laesi_tf.models.area import to_area_cm2

METHOD = "regression"


class Regression:
    """The area network of a run; a segmentation, where given, adds the mask and outline but not the area."""

    def __init__(
        self,
        model: keras.Model,
        size: tuple[int, int],
        transform: str,
        *,
        segmentation: Segmentation | None = None,
    ) -> None:
        """Take a model that maps [1, h, w, 3] in 0..255 to [1, n], transformed area first; `size` is (h, w)."""
        self._size = size
        self._transform = transform
        self._segmentation = segmentation
        self._predict = compiled(model, size)

    def measure(self, image: np.ndarray, known: Known = NOTHING) -> Measurement:
        """As `Estimator.measure`, for one leaf; where the segmentation finds none, the photo is refused."""
        small, _ = fit(image, self._size)
        area = float(to_area_cm2(self._predict(small)[0], self._transform))
        mask = None if self._segmentation is None else self._segmentation.silhouette(image)
        refusal = _refusal(area, mask)
        if refusal is not None:
            return Measurement(method=METHOD, mask=mask, refusal=refusal)
        leaf = Leaf(area_cm2=area, outline=None if mask is None else trace(mask))
        return Measurement(method=METHOD, leaves=(leaf,), mask=mask)


def _refusal(area_cm2: float, mask: np.ndarray | None) -> str | None:
    if not math.isfinite(area_cm2):
        return "the area model gives no number; train it again"
    return NO_LEAF if mask is not None and not mask.any() else None
