"""Things on a sheet that have the colour of leaves and were not counted."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, Points
from laesi_tf.common.geometry import to_cv2_points
from laesi_tf.estimators.leaf_colour import find_leaf_colour
from laesi_tf.estimators.leaf_outline import LeafOutlineParams, looks_like_coin, looks_made
from laesi_tf.estimators.mask_estimator import MaskEstimatorParams
from laesi_tf.estimators.photo_pyramid import PhotoPyramid

_SUBPIXEL_BITS = 4


class UncountedThings(NamedTuple):
    """What looks like leaves and was not counted."""

    number: int
    relative_area: float
    """Their area over that of the leaves that were counted."""


def find_uncounted(
    pyramid: PhotoPyramid,
    counted: Sequence[Points],
    others: Sequence[Points],
    sheet: Points | None,
    params: MaskEstimatorParams,
) -> UncountedThings:
    """Find the things on the sheet that look like leaves and are none of those that were found.

    `counted` are the outlines [n, 2] of leaves on the sheet, `others` those beside it, and `sheet` is the
    convex outline [n, 2] of the sheet or None, in photo pixels. `params` tell the colour of leaves, and the
    shapes of notes, pens and coins.
    """
    colour = find_leaf_colour(pyramid, [*counted, *others], params.detector.colour)
    on_sheet = None
    if sheet is not None:
        painted = np.zeros(colour.crop.size, np.uint8)
        corners = to_cv2_points(colour.crop.from_photo(sheet), shift=_SUBPIXEL_BITS)
        cv2.fillConvexPoly(painted, corners, 1, shift=_SUBPIXEL_BITS)
        on_sheet = painted > 0
    things = colour.find_things(on_sheet)
    left_out = [thing for thing in things if not _has_made_shape(thing, params.outline)]
    area = sum(int(np.count_nonzero(thing)) for thing in left_out)
    counted_px = int(np.count_nonzero(colour.crop.paint(counted)))
    return UncountedThings(len(left_out), area / max(counted_px, 1))


def _has_made_shape(thing: Mask, shapes: LeafOutlineParams) -> bool:
    """Return whether a thing, bool [h, w], has the shape of a note, a pen or a coin."""
    contours, _ = cv2.findContours(thing.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline: Points = max(contours, key=cv2.contourArea)[:, 0].astype(np.float64)
    return looks_made(outline, shapes) or looks_like_coin(outline, shapes)
