"""Points, polygons and contours in NumPy, in one convention.

Points are (x, y) floats in the last axis of an array. The pixel in row i and column j covers [j, j + 1] x
[i, i + 1], so that its centre lies at (j + 0.5, i + 0.5) and an image covers [0, width] x [0, height]. OpenCV
places pixel centres at whole numbers; only `from_cv2_contour` and `to_cv2_points` know it. Its boxes
(`boundingRect`, `connectedComponentsWithStats`) are in this convention already: left, top, width and height
count whole pixels.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, Points

_SMOOTHING_PX = 1.0
"""Standard deviation of the blur, pixels, whose level of one half an outline follows: it removes steps."""
_LOGIT_TO_SIGMA = 0.6
"""Slope of the normal distribution's quantile by the logit: within 5 % from 0.1 to 0.9."""
_PADDING_PX = 4
_MIN_HOLE_PX = 6.0
"""Area in pixels below which a hole is noise."""


class ImageSize(NamedTuple):
    """Height and width of an image in pixels."""

    height: int
    width: int

    @classmethod
    def of(cls, image: NDArray[Any]) -> "ImageSize":
        """Return the size of `image` [H, W, ...]."""
        return cls(image.shape[0], image.shape[1])

    @property
    def xy(self) -> Points:
        """int [2]: the image's lower right corner, (width, height)."""
        return np.array([self.width, self.height])


class Polygon(NamedTuple):
    """An outline with its holes."""

    outer: Points
    """[N, 2] outer contour."""
    holes: tuple[Points, ...] = ()
    """The contours [n, 2] of its holes."""

    @property
    def rings(self) -> tuple[Points, ...]:
        """The outer contour, then those of the holes."""
        return self.outer, *self.holes


def from_cv2_contour(contour: NDArray[np.int32]) -> Points:
    """Return OpenCV's `contour` [N, 1, 2], pixel centres at whole numbers, as points float64 [N, 2]."""
    return contour[:, 0].astype(np.float64) + 0.5


def to_cv2_points(points: Points, *, shift: int = 0) -> NDArray[np.int32]:
    """Return `points` [N, 2] as int32 [N, 2] for OpenCV's drawing functions, with `shift` fractional bits."""
    return np.round((points - 0.5) * 2**shift).astype(np.int32)


def pixel_centres(mask: Mask) -> Points:
    """Return the centres [N, 2] of the nonzero pixels of `mask` [H, W]."""
    return np.argwhere(mask)[:, ::-1].astype(np.float64) + 0.5


def polygon_area(polygon: Points) -> float:
    """Return the area within `polygon` [N, 2] by the shoelace formula; its sign tells the orientation."""
    x, y = (polygon - polygon[0]).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def polygon_perimeter(polygon: Points) -> float:
    """Return the length of the closed `polygon` [N, 2]."""
    return float(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum())


def polygon_centroid(polygon: Points) -> Points:
    """Return the centroid [2] of the area within `polygon` [N, 2]."""
    middle = polygon.mean(axis=0)
    start, end = polygon - middle, np.roll(polygon - middle, -1, axis=0)
    cross = start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]
    moment = ((start + end) * cross[:, np.newaxis]).sum(axis=0)
    return middle + moment / max(3 * abs(cross.sum()), 1e-9) * np.sign(cross.sum())


def polygon_main_axis(polygon: Points) -> Points:
    """Return the direction [2], of unit length, in which the area within `polygon` [N, 2] extends most.

    It is the principal axis of the area's second moments and does not depend on where the vertices lie.
    """
    start = polygon - polygon_centroid(polygon)
    end = np.roll(start, -1, axis=0)
    cross = start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]
    pairs = ((start, start), (start, end), (end, end))
    same_start, mixed, same_end = (np.einsum("n,ni,nj->ij", cross, a, b) for a, b in pairs)
    moments = same_start + (mixed + mixed.T) / 2 + same_end
    return np.linalg.eigh(moments * np.sign(cross.sum()))[1][:, 1]


def trace_polygons(mask: Mask) -> list[Polygon]:
    """Trace the connected components of `mask`, bool [h, w], largest first; none of an empty mask.

    The outlines follow the level of one half of the slightly blurred mask, with subpixel precision. Holes of
    less than 6 pixels are left out.
    """
    padded = np.pad(mask.astype(np.uint8), _PADDING_PX)
    contours, hierarchy = cv2.findContours(padded, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return []
    parents = hierarchy[0, :, 3]
    outer = [index for index in range(len(contours)) if parents[index] < 0]
    outer.sort(key=lambda index: cv2.contourArea(contours[index]), reverse=True)
    blurred = cv2.GaussianBlur(padded.astype(np.float32), (0, 0), _SMOOTHING_PX)
    polygons = []
    for index in outer:
        inner = [contours[hole] for hole in range(len(contours)) if parents[hole] == index]
        holes = [_move_to_half_level(blurred, hole) for hole in inner]
        large = tuple(hole for hole in holes if abs(polygon_area(hole)) >= _MIN_HOLE_PX)
        polygons.append(Polygon(_move_to_half_level(blurred, contours[index]), large))
    return polygons


def _move_to_half_level(blurred: FloatMap, contour: NDArray[np.int32]) -> Points:
    """Move the pixels of OpenCV's `contour` [N, 1, 2] along the gradient to where `blurred` is one half.

    Returns points [N, 2] in the mask without its padding.
    """
    x, y = contour[:, 0].T
    slope_x, slope_y = blurred[y, x + 1] - blurred[y, x - 1], blurred[y + 1, x] - blurred[y - 1, x]
    gradient = np.stack([slope_x, slope_y], axis=1) / 2
    level = np.clip(blurred[y, x], 0.02, 0.98)
    # The distance inside a straight edge at which the blur has this level is nearly the normal quantile.
    depth = _LOGIT_TO_SIGMA * _SMOOTHING_PX * np.log(level / (1 - level))
    # A line one pixel wide has no gradient to follow.
    outward = -gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 0.05)
    return from_cv2_contour(contour) + depth[:, np.newaxis] * outward - _PADDING_PX
