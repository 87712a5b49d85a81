"""Points, homographies, polygons and contours in NumPy, in one convention."""

import cv2
import numpy as np


def trace_largest_contour(mask: np.ndarray) -> np.ndarray:
    """Outer contour [N, 2], (x, y) at pixel centres, of the largest piece of `mask`, bool [H, W]."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return max(contours, key=cv2.contourArea)[:, 0, :]


_SMOOTH = 1.0
"""Standard deviation, pixels, of the blur whose level of one half the outline follows: it takes the steps
off."""
_LOGIT_TO_SIGMA = 0.6
_PAD = 4
_LEAST_HOLE_PX = 6.0


def trace_polygons(mask: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Outer margin and holes of the largest piece of `mask`, bool [h, w].

    Each is [N, 2], (x, y) with pixel centres at halves.
    """
    padded = np.pad(mask.astype(np.uint8), _PAD)
    contours, hierarchy = cv2.findContours(padded, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outer = max(
        (index for index in range(len(contours)) if hierarchy[0, index, 3] < 0),
        key=lambda index: cv2.contourArea(contours[index]),
    )
    inner = [contours[index] for index in range(len(contours)) if hierarchy[0, index, 3] == outer]
    soft = cv2.GaussianBlur(padded.astype(np.float32), (0, 0), _SMOOTH)
    holes = [_move_to_half_level(soft, hole[:, 0]) for hole in inner]
    return _move_to_half_level(soft, contours[outer][:, 0]), tuple(
        hole for hole in holes if abs(polygon_area(hole)) >= _LEAST_HOLE_PX
    )


def _move_to_half_level(soft: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Border `pixels` [N, 2] moved along the slope of the blurred mask to where it is one half."""
    x, y = pixels.T
    slope = np.stack([soft[y, x + 1] - soft[y, x - 1], soft[y + 1, x] - soft[y - 1, x]], axis=1) / 2
    level = np.clip(soft[y, x], 0.02, 0.98)
    # How far inside a straight edge the blur has this level: nearly the normal distribution's quantile.
    depth = _LOGIT_TO_SIGMA * _SMOOTH * np.log(level / (1 - level))
    # On a line a pixel wide there is no slope to follow.
    outward = -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 0.05)
    return pixels + depth[:, None] * outward + 0.5 - _PAD


def apply_homography(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """`points` [N, 2] through a homography [3, 3]."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def compute_px_per_mm(to_mm: np.ndarray, point: np.ndarray) -> float:
    """Scale at `point` [2] of a homography from pixels to mm, in geometric mean over directions."""
    w = to_mm[2] @ [*point, 1]
    return float(np.sqrt(abs(w) ** 3 / abs(np.linalg.det(to_mm))))


def polygon_centroid(outline: np.ndarray) -> np.ndarray:
    """Middle [2] of the area within a polygon [N, 2]."""
    middle = outline.mean(axis=0)
    one, other = outline - middle, np.roll(outline - middle, -1, axis=0)
    cross = one[:, 0] * other[:, 1] - other[:, 0] * one[:, 1]
    return middle + ((one + other) * cross[:, None]).sum(axis=0) / max(3 * abs(cross.sum()), 1e-9) * np.sign(
        cross.sum()
    )


def main_axis(outline: np.ndarray) -> np.ndarray:
    """Direction [2], of unit length, in which the area within a polygon [N, 2] extends most."""
    one = outline - polygon_centroid(outline)
    other = np.roll(one, -1, axis=0)
    cross = one[:, 0] * other[:, 1] - other[:, 0] * one[:, 1]
    products = [np.einsum("n,ni,nj->ij", cross, a, b) for a, b in ((one, one), (one, other), (other, other))]
    moments = products[0] + (products[1] + products[1].T) / 2 + products[2]
    return np.linalg.eigh(moments * np.sign(cross.sum()))[1][:, 1]


def polygon_area(polygon: np.ndarray) -> float:
    x, y = (polygon - polygon[0]).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)
