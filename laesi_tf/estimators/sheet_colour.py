"""Whether a leaf lies on the sheet beyond the lines that were read: leaves near an edge hide them."""

from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.arrays import Points
from laesi_tf.common.geometry import to_cv2_points
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, shrink

_SET_ON = "semi-real photos with pasted leaves, rendered (split develop); 2026-11-30"


@dataclass(frozen=True, kw_only=True)
class SheetColourParams:
    """Parameters of the comparison of what surrounds a leaf with the ruled part of the sheet."""

    side_px: int = parameter(448, unit="pixels", set_on=_SET_ON)
    """Longer side of the image that is compared."""
    window_px: int = parameter(9, unit="pixels", set_on=_SET_ON)
    """Side of the window in which colours are averaged, over lines of the ruling."""
    ring_px: tuple[int, int] = parameter((5, 13), unit="pixels", set_on=_SET_ON)
    """Distances from the leaf between which its surroundings are seen."""
    near: float = parameter(0.5, unit="leaf sizes (square root of its area)", set_on=_SET_ON)
    """The sheet is seen within this distance, as light falls off; beyond it where it shows none there."""
    max_tint: float = parameter(8.0, unit="CIELAB", set_on=_SET_ON)
    """Largest difference of a* and of b*."""
    max_shade: float = parameter(0.5, unit="ln", set_on=_SET_ON)
    """Largest difference of the lightness."""
    least_share: float = parameter(0.75, unit="share of the surroundings", set_on=_SET_ON)
    """So much of what surrounds a leaf on the sheet has the sheet's colour."""


def is_surrounded_by_sheet(overview: Crop, leaf: Points, sheet: Points, params: SheetColourParams) -> bool:
    """Return whether what surrounds a leaf has the colour of the sheet beside it.

    `leaf` [n, 2] and `sheet` [m, 2], the convex outline of the ruled part, are in photo pixels.
    """
    small = shrink(overview, params.side_px)
    window = (params.window_px, params.window_px)
    lab = cv2.cvtColor(cv2.blur(small.image, window).astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    outside = np.full(small.size, 255, np.uint8)
    cv2.fillPoly(outside, [to_cv2_points(small.from_photo(leaf))], 0)
    distance = cv2.distanceTransform(outside, cv2.DIST_L2, 3)
    ruled = np.zeros(small.size, np.uint8)
    cv2.fillConvexPoly(ruled, to_cv2_points(small.from_photo(sheet)), 1)
    nearest, farthest = params.ring_px
    # At its border cells of the ruling show some desk.
    is_sheet = (cv2.distanceTransform(ruled, cv2.DIST_L2, 3) > farthest) & (distance > nearest)
    is_near = is_sheet & (distance < params.near * np.sqrt(np.count_nonzero(outside == 0)) + farthest)
    ring = (distance > nearest) & (distance <= farthest)
    if not ring.any() or not is_sheet.any():
        return False
    expected = np.median(lab[is_near if is_near.any() else is_sheet], axis=0)
    tint = np.abs(lab[ring, 1:] - expected[1:]).max(axis=1)
    shade = np.abs(np.log(np.maximum(lab[ring, 0], 1) / max(expected[0], 1)))
    return bool(((tint < params.max_tint) & (shade < params.max_shade)).mean() >= params.least_share)
