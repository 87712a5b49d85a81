"""Fill a region with the paper around it: what would be seen if there were no leaf.

The paper is copied from another place of the image, moved such that the printed lines beside the region
continue: the displacement at which the surroundings of the region agree best.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, RgbImage

_RING_PX = 9
"""Width of the surroundings that are compared: two to four printed lines."""
_EDGE_PX = 2
"""Pixels beside the mask that still have colour of the leaf."""
_MAX_COPIES = 10
_MIN_GAIN = 0.2
"""Share of the region that a copy must fill, where any place allows it: several good copies are better than
one of the desk."""
_MIN_COMPARED = 0.3
"""Share of the surroundings that must be known at the other place."""


def fill_with_paper(image: RgbImage, mask: Mask) -> RgbImage:
    """Return `image` [H, W, 3] with paper in place of `mask` [H, W] and of two pixels around it.

    A region larger than the paper beside it is filled in several copies; what none of them reaches gets the
    median colour of the paper.
    """
    missing = _dilate(mask, _EDGE_PX)
    background = np.median(image[~missing], axis=0) if not missing.all() else np.full(3, 255)
    filled = image.copy()
    for _ in range(_MAX_COPIES):
        if not missing.any() or not _copy_paper(filled, missing):
            break
    filled[missing] = background.astype(np.uint8)
    return filled


def _copy_paper(image: RgbImage, missing: Mask) -> bool:
    """Copy paper into `image` where it is `missing`, and take it from `missing`; False if nothing fits."""
    rows, columns = np.nonzero(missing)
    height, width = missing.shape
    top, bottom = max(0, rows.min() - _RING_PX), min(height, rows.max() + 1 + _RING_PX)
    left, right = max(0, columns.min() - _RING_PX), min(width, columns.max() + 1 + _RING_PX)
    box = (slice(top, bottom), slice(left, right))
    needed = missing[box].copy()
    near = _dilate(needed, _RING_PX)
    ring = (near & ~needed).astype(np.float32)
    if not ring.any():
        return False
    difference, compared = _compare_places(image, ~missing, image[box], ring)
    filled = 1 - _correlate(missing, needed) / needed.sum()
    is_useful = (filled >= min(_MIN_GAIN, filled.max() - 0.01)) & (compared > _MIN_COMPARED * ring.sum())
    difference[~is_useful] = np.inf
    y, x = np.unravel_index(np.argmin(difference), difference.shape)
    source = (slice(int(y), int(y) + bottom - top), slice(int(x), int(x) + right - left))
    usable = needed & ~missing[source]
    patch = image[source].copy()
    image[box][usable] = patch[usable]
    missing[box][usable] = False
    return bool(usable.any())


def _compare_places(
    image: RgbImage, is_known: Mask, patch: RgbImage, weights: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """Compare `patch` [h, w, 3] with every place of `image` [H, W, 3].

    Pixels count that have a weight [h, w] in the patch and are known [H, W] in the image. Returns the mean
    squared difference and the sum of the weights, [H - h + 1, W - w + 1].
    """
    known, pixels, template = is_known.astype(np.float32), image.astype(np.float32), patch.astype(np.float32)
    compared = _correlate(known, weights)
    total = _correlate(known, weights * (template**2).sum(axis=-1))
    total += _correlate(known * (pixels**2).sum(axis=-1), weights)
    for channel in range(3):
        total -= 2 * _correlate(known * pixels[..., channel], weights * template[..., channel])
    return (total / np.maximum(compared, 1)).astype(np.float32), compared


def _correlate(image: NDArray[Any], template: NDArray[Any]) -> FloatMap:
    """Return the sums of products of `template` [h, w] with each part of `image` [H, W]."""
    return cv2.matchTemplate(image.astype(np.float32), template.astype(np.float32), cv2.TM_CCORR)


def _dilate(mask: Mask, radius: int) -> Mask:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.astype(np.uint8), kernel) > 0
