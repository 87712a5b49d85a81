"""Things on a sheet that have the colour of leaves and were not counted.

The mask network misses some leaves beside a larger one. A photo of one leaf shows coins, notes and pens as
well, so colour and shape do not suffice to count a thing as leaf; but they suffice to say that there is one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, Points, RgbImage
from laesi_tf.common.geometry import to_cv2_points
from laesi_tf.estimators.leaf_outline import LeafOutlineParams, looks_like_coin, looks_made
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import PhotoPyramid, shrink

_SET_ON = "rendered (split develop), semi-real and phone scenes with pasted leaves, 2026-11-29"
_SUBPIXEL_BITS = 4


@dataclass(frozen=True, kw_only=True)
class UncountedThingsParams:
    """Parameters of the search for things that were not counted."""

    side_px: int = parameter(448, unit="pixels", set_on=_SET_ON)
    """Longer side of the image that is searched."""
    sheet_window: float = parameter(0.33, unit="share of the shorter side", set_on=_SET_ON)
    """Side of the window whose median colour is the sheet's."""
    min_difference: float = parameter(18.0, unit="CIELAB", set_on=_SET_ON)
    """Least difference of hue and saturation from the sheet: shadows have little of their own."""
    leaf_hues: tuple[float, float] = parameter((50.0, 160.0), unit="degrees", set_on="orange to blue-green")
    """Hues of the difference in CIELAB: 90 is yellow, 180 green."""
    min_area_px: float = parameter(40.0, unit="pixels", set_on=_SET_ON)
    """Smaller things are print."""
    min_area: float = parameter(0.05, unit="median leaf's area", set_on=_SET_ON)
    """The same, relative to the leaves that were counted."""
    counted_share: float = parameter(0.2, unit="share of the thing", set_on=_SET_ON)
    """Of a thing that belongs to a counted leaf, at least so much lies on it or close to it."""


def count_uncounted(
    pyramid: PhotoPyramid,
    leaves: Sequence[Points],
    sheet: Points | None,
    params: UncountedThingsParams,
    shapes: LeafOutlineParams,
) -> int:
    """Return how many things on the sheet look like leaves and are none of `leaves`.

    `leaves` are outlines [n, 2] and `sheet` is the convex outline [n, 2] of the sheet or None, in photo
    pixels. `shapes` tell notes, pens and coins.
    """
    small = shrink(pyramid.overview, params.side_px)
    outlines = [small.from_photo(leaf) for leaf in leaves]
    counted = np.zeros(small.size, np.uint8)
    cv2.fillPoly(counted, [to_cv2_points(outline) for outline in outlines], 1)
    least = max(params.min_area_px, params.min_area * _median_area(outlines))
    near = cv2.dilate(counted, np.ones((7, 7), np.uint8)) > 0
    marked = _mark_leaf_colour(small.image, params)
    if sheet is not None:
        on_sheet = np.zeros(small.size, np.uint8)
        corners = to_cv2_points(small.from_photo(sheet), shift=_SUBPIXEL_BITS)
        cv2.fillConvexPoly(on_sheet, corners, 1, shift=_SUBPIXEL_BITS)
        marked &= on_sheet > 0
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(marked.astype(np.uint8))
    large = np.flatnonzero(statistics[1:, cv2.CC_STAT_AREA] >= least) + 1
    things = (labels == label for label in large)
    return sum(
        near[thing].mean() < params.counted_share and not _has_made_shape(thing, shapes) for thing in things
    )


def _median_area(outlines: Sequence[Points]) -> float:
    areas = [cv2.contourArea(outline.astype(np.float32)) for outline in outlines]
    return float(np.median(areas)) if areas else 0.0


def _mark_leaf_colour(image: RgbImage, params: UncountedThingsParams) -> Mask:
    """Return where `image`, uint8 [h, w, 3], differs from the sheet towards the colours of leaves."""
    hues = np.ascontiguousarray(cv2.cvtColor(image, cv2.COLOR_RGB2LAB)[..., 1:])
    side = min(255, int(params.sheet_window * min(image.shape[:2])) | 1)
    # OpenCV's large windows need 8 bits, which CIELAB has here.
    sheet = np.dstack([cv2.medianBlur(channel, side) for channel in cv2.split(hues)])
    difference = hues.astype(np.float32) - sheet
    smooth = cv2.blur(difference, (3, 3))
    chroma = np.hypot(smooth[..., 0], smooth[..., 1])
    hue = np.degrees(np.arctan2(smooth[..., 1], smooth[..., 0]))
    low, high = params.leaf_hues
    marked = ((chroma > params.min_difference) & (hue > low) & (hue < high)).astype(np.uint8)
    return cv2.morphologyEx(marked, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0


def _has_made_shape(thing: Mask, shapes: LeafOutlineParams) -> bool:
    """Return whether a thing, bool [h, w], has the shape of a note, a pen or a coin."""
    contours, _ = cv2.findContours(thing.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline: Points = max(contours, key=cv2.contourArea)[:, 0].astype(np.float64)
    return looks_made(outline, shapes) or looks_like_coin(outline, shapes)
