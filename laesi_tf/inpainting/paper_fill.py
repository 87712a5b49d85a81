"""Fill a region with the paper around it: what would be seen if there were no leaf.

The paper is copied from another place of the image, moved such that the printed lines beside the region
continue: the displacement at which the surroundings of the region agree best.
"""

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, RgbImage

_RING_PX = 9
"""Width of the surroundings that are compared: two to four printed lines."""
_EDGE_PX = 2
"""Pixels beside the mask that still have colour of the leaf."""
_MAX_COPIES = 6
_CLASH_TOLERANCE = 0.05


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
    pixels = image.astype(np.float32)
    weights = np.repeat(ring[..., np.newaxis], 3, axis=-1)
    difference = cv2.matchTemplate(pixels, pixels[box], cv2.TM_SQDIFF, mask=weights)
    overlap = cv2.matchTemplate(missing.astype(np.float32), near.astype(np.float32), cv2.TM_CCORR)
    overlap /= near.sum()
    difference[overlap > overlap.min() + _CLASH_TOLERANCE] = np.inf
    y, x = np.unravel_index(np.argmin(difference), difference.shape)
    source = (slice(int(y), int(y) + bottom - top), slice(int(x), int(x) + right - left))
    usable = needed & ~missing[source]
    patch = image[source].copy()
    image[box][usable] = patch[usable]
    missing[box][usable] = False
    return bool(usable.any())


def _dilate(mask: Mask, radius: int) -> Mask:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.astype(np.uint8), kernel) > 0
