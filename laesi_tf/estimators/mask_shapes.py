"""Distances and shapes in masks."""

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask


def distance_inside(mask: Mask) -> FloatMap:
    """Return the distance in pixels of each pixel of `mask`, bool [h, w], from the nearest one outside."""
    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)


def make_disc(radius: float) -> NDArray[np.uint8]:
    """Return a disc of at least one pixel's radius as a structuring element, uint8."""
    side = 2 * max(1, round(radius)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))


def make_square(reach: int) -> NDArray[np.uint8]:
    """Return a square that reaches `reach` pixels from its middle as a structuring element, uint8."""
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def grow_mask(mask: Mask, pixels: int) -> Mask:
    """Return `mask`, bool [h, w], grown by `pixels` to all sides, its corners square."""
    return cv2.dilate(mask.astype(np.uint8), make_square(pixels)) > 0


def close_mask(mask: Mask, shape: NDArray[np.uint8]) -> Mask:
    """Return `mask`, bool [h, w], without gaps and bays that `shape` does not fit into."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, shape) > 0


def open_mask(mask: Mask, shape: NDArray[np.uint8]) -> Mask:
    """Return `mask`, bool [h, w], without parts that `shape` does not fit into."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, shape) > 0


def open_by_distance(mask: Mask, radius: float) -> Mask:
    """Return the parts of `mask`, bool [h, w], that a disc of `radius` pixels fits into."""
    centres = distance_inside(mask) > radius
    return distance_inside(~centres) <= radius if centres.any() else centres
