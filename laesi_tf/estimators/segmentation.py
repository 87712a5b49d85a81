"""Area as the leaf's silhouette times a scale that is given: a network finds the silhouette."""

import cv2
import keras
import numpy as np

from laesi_tf.data.fitting import fit
from laesi_tf.estimators.base import NOTHING, Known, Leaf, Measurement, trace
from laesi_tf.estimators.network import compiled

METHOD = "mask x given scale"
_ROOM = 1.3
"""Side of the close view in units of the leaf's longer side."""
_WORTHWHILE = 1.2
"""A close view must enlarge the leaf at least this much."""
NO_LEAF = "no leaf found; show one whole leaf on the paper"


class Segmentation:
    """The mask network of a run; it finds no scale itself and refuses the area when none is given.

    One leaf is measured, the largest: on real photos the network also marks specks of soil and print.
    """

    def __init__(self, model: keras.Model, size: tuple[int, int]) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> leaf probability [B, h, w, 1]; `size` is (h, w)."""
        self._size = size
        self.side = max(size)
        self._predict = compiled(model, size)

    def measure(self, image: np.ndarray, known: Known = NOTHING) -> Measurement:
        """As `Estimator.measure`; mask and outline are given even where the area is refused."""
        mask = self.silhouette(image)
        if not mask.any():
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        area = None if known.px_per_mm is None else float(mask.sum()) / known.px_per_mm**2 / 100
        leaf = Leaf(area_cm2=area, px_per_mm=known.px_per_mm, outline=trace(mask))
        refusal = "the scale is not known; give px_per_mm or use an area model" if area is None else None
        return Measurement(method=METHOD, leaves=(leaf,), mask=mask, refusal=refusal)

    def silhouette(self, image: np.ndarray) -> np.ndarray:
        """bool [H, W], True on the largest leaf of `image`, uint8 [H, W, 3]; all False where none is.

        A leaf that is small in the photo is looked at twice, the second time as close as scenes are trained.
        """
        mask = self._find(image)
        close = _around(mask)
        if close is None:
            return mask
        closer = self._find(image[close])
        if not closer.any():
            return mask
        result = np.zeros_like(mask)
        result[close] = closer
        return result

    def _find(self, image: np.ndarray) -> np.ndarray:
        small, placement = fit(image, self._size)
        probability = self._predict(small)[:, :, 0]
        # Upsampled before the threshold, the margin follows the probabilities and shows no steps.
        return placement.to_photo(_largest(probability)) >= 0.5


def _around(mask: np.ndarray) -> tuple[slice, slice] | None:
    """The square that holds the leaf of `mask` with room around it; None where that would bring little."""
    if not mask.any():
        return None
    spans = [np.flatnonzero(mask.any(axis=axis))[[0, -1]] for axis in (1, 0)]
    side = round(_ROOM * max(high - low + 1 for low, high in spans))
    if side * _WORTHWHILE > max(mask.shape):
        return None
    corners = [(low + high - side) // 2 for low, high in spans]
    rows, columns = (slice(max(corner, 0), corner + side) for corner in corners)
    return rows, columns


def _largest(probability: np.ndarray) -> np.ndarray:
    """`probability` [h, w] with all but the largest connected piece above one half set to zero."""
    count, labels, statistics, _ = cv2.connectedComponentsWithStats((probability >= 0.5).astype(np.uint8))
    if count <= 2:
        return probability
    largest = 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    # A pixel of slope is left around the piece, for the upsampling.
    near = cv2.dilate((labels == largest).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    return np.where(near & ((labels == largest) | (labels == 0)), probability, 0)
