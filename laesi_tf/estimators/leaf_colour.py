"""Things that have the colour of leaves: compared with the sheet, as light and white balance change both.

The mask network misses some leaves beside a larger one. A photo of one leaf shows coins, notes and pens as
well, so colour does not suffice to count a thing as leaf; but it suffices to look closer, and to say so.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, Points, RgbImage
from laesi_tf.common.geometry import pixel_centres, polygon_area
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid, shrink

MAX_MEDIAN_SIDE = 255
"""The largest window of OpenCV's median filter."""
_SET_ON = "rendered (split develop), semi-real and phone scenes with pasted leaves, 2026-11-29"


@dataclass(frozen=True, kw_only=True)
class LeafColourParams:
    """Parameters of the colour of leaves."""

    side_px: int = parameter(448, unit="pixels", set_on=_SET_ON)
    """Longer side of the image that is searched."""
    sheet_window: float = parameter(0.33, unit="share of the shorter side", set_on=_SET_ON)
    """Side of the window whose median colour is the sheet's."""
    min_difference: float = parameter(18.0, unit="CIELAB", set_on=_SET_ON)
    """Least difference of hue and saturation from the sheet: shadows have little of their own."""
    hues: tuple[float, float] = parameter((50.0, 160.0), unit="degrees", set_on="orange to blue-green")
    """Hues of the difference in CIELAB: 90 is yellow, 180 green."""
    hues_from_red: tuple[float, float] = parameter(
        (-30.0, 160.0), unit="degrees", set_on="purple to blue-green"
    )
    """Hues of leaves of any kind, which ink seldom has."""
    green_hues: tuple[float, float] = parameter(
        (115.0, 160.0), unit="degrees", set_on="coins of rendered (split develop), 2026-11-30"
    )
    """Hues of leaves that are green, which coins never are."""
    min_green: float = parameter(12.0, unit="CIELAB", set_on=_SET_ON)
    """Least saturation of what is green."""
    max_black: float = parameter(
        30.0, unit="CIELAB", set_on="phone scenes of seeds 81 and 82, rendered (split develop); 2026-12-01"
    )
    """Largest lightness of black, relative to the sheet."""
    sampled_side_px: int = parameter(128, unit="pixels", set_on="what a median needs, 2026-11-30")
    """The colour of a thing is measured on at least so many rows and columns of a crop."""
    max_grey: float = parameter(6.0, unit="levels of 255", set_on="JPEG files of grey scans")
    """Red, green and blue differ at most so much on a photo without colours."""
    min_area_px: float = parameter(40.0, unit="pixels", set_on=_SET_ON)
    """Least area of a thing: what is smaller is print."""
    min_area: float = parameter(0.05, unit="median leaf's area", set_on=_SET_ON)
    """The same, relative to the leaves that were found."""
    found_share: float = parameter(0.2, unit="share of the thing", set_on=_SET_ON)
    """Of a thing that belongs to a leaf that was found, at least so much lies on it or close to it."""


@dataclass(frozen=True, eq=False)
class LeafColour:
    """Where a photo has the colour of leaves."""

    crop: Crop
    """The whole photo in few pixels."""
    marked: Mask
    """bool [h, w], True there."""
    near_found: Mask
    """bool [h, w], True on the leaves that were found, and close to them."""
    least_px: float
    """Least area of a thing in pixels of `crop`."""
    params: LeafColourParams
    """Parameters it was found with."""

    def find_things(self, within: Mask | None = None) -> list[Mask]:
        """Return the things, bool [h, w], that are none of the leaves that were found.

        With `within`, bool [h, w], they are only looked for there.
        """
        marked = self.marked if within is None else self.marked & within
        _, labels, statistics, _ = cv2.connectedComponentsWithStats(marked.astype(np.uint8))
        large = np.flatnonzero(statistics[1:, cv2.CC_STAT_AREA] >= self.least_px) + 1
        things = (labels == label for label in large)
        return [thing for thing in things if self.near_found[thing].mean() < self.params.found_share]

    def find_boxes(self) -> list[Points]:
        """Return the boxes [[left, top], [right, bottom]] of such things, photo pixels."""
        centres = (pixel_centres(thing) for thing in self.find_things())
        return [
            self.crop.to_photo(np.stack([points.min(axis=0) - 0.5, points.max(axis=0) + 0.5]))
            for points in centres
        ]


def find_leaf_colour(pyramid: PhotoPyramid, found: Sequence[Points], params: LeafColourParams) -> LeafColour:
    """Find where a photo differs from the sheet, the median of what lies around, towards yellow or green.

    `found` are outlines [n, 2] of leaves, photo pixels: the sheet is what lies around them.
    """
    crop = shrink(pyramid.overview, params.side_px)
    areas = [abs(polygon_area(crop.from_photo(leaf))) for leaf in found]
    least_px = max(params.min_area_px, params.min_area * float(np.median(areas or [0.0])))
    near = cv2.dilate(crop.paint(found), np.ones((7, 7), np.uint8)) > 0
    sheet = _estimate_sheet(crop.image, near, params.sheet_window)
    lab = _to_relative_lab(cv2.blur(crop.image, (3, 3)), sheet)
    marked = _has_hue(lab, params.hues, params.min_difference).astype(np.uint8)
    opened = cv2.morphologyEx(marked, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return LeafColour(crop, opened > 0, near, least_px, params)


@dataclass(frozen=True, eq=False)
class ThingColour:
    """The colour of one thing on a sheet."""

    lab: NDArray[np.float32]
    """float32 [3], CIELAB relative to the sheet, as if that were white."""
    is_known: bool
    """False on a photo without colours."""

    def is_green(self, params: LeafColourParams) -> bool:
        """Return whether it is green."""
        return bool(_has_hue(self.lab, params.green_hues, params.min_green))

    def is_ink(self, params: LeafColourParams) -> bool:
        """Return whether it is black, grey, blue or violet."""
        return self.is_known and not _has_hue(self.lab, params.hues_from_red, params.min_difference)

    def is_black(self, params: LeafColourParams) -> bool:
        """Return whether it is black, and no yellower than the sheet: dark leaves are."""
        return self.is_ink(params) and bool(self.lab[0] < params.max_black and self.lab[2] < 0)


def measure_colour(image: RgbImage, thing: Mask, params: LeafColourParams) -> ThingColour:
    """Measure the colour of `thing`, bool [h, w], on a crop, uint8 [h, w, 3], elsewhere mostly sheet."""
    # A median needs few pixels; those of a thing may be few already.
    grid = (slice(None, None, max(1, max(thing.shape) // params.sampled_side_px)),) * 2
    within = image[thing]
    within = within[:: max(1, len(within) // params.sampled_side_px**2)]
    around = image[grid][~thing[grid]] if not thing[grid].all() else within
    colours = np.concatenate([within, around])
    least = 255 - largest_channel(255 - colours)
    ranges = largest_channel(colours) - least
    if not len(within) or np.percentile(ranges, 99.9) <= params.max_grey:
        return ThingColour(np.zeros(3, np.float32), is_known=False)
    within, sheet = np.median(within, axis=0), np.median(around, axis=0)
    return ThingColour(_to_relative_lab(within.reshape(1, 1, 3), sheet)[0, 0], is_known=True)


def largest_channel(colours: NDArray[Any]) -> NDArray[Any]:
    """Return the largest channel of `colours` [..., 3]: [...]. NumPy's maximum of three numbers is slow."""
    return np.maximum(np.maximum(colours[..., 0], colours[..., 1]), colours[..., 2])


def _to_relative_lab(image: NDArray[Any], sheet: NDArray[Any]) -> FloatMap:
    """Return the colours of `image` [h, w, 3] in CIELAB as if `sheet`, which broadcasts to it, were white.

    What is brighter than the sheet, as leaves on black cloth are, keeps its hue.
    """
    relative = image.astype(np.float32) / np.maximum(sheet, 1).astype(np.float32)
    relative /= np.maximum(largest_channel(relative), 1)[..., np.newaxis]
    return cv2.cvtColor(relative, cv2.COLOR_RGB2LAB)


def _has_hue(lab: NDArray[np.float32], hues: tuple[float, float], least: float) -> NDArray[np.bool_]:
    """Return where colours [..., 3] have a hue between two and at `least` this saturation."""
    a, b = lab[..., 1], lab[..., 2]
    hue = np.degrees(np.arctan2(b, a))
    return (hue > hues[0]) & (hue < hues[1]) & (np.hypot(a, b) > least)


def _estimate_sheet(image: RgbImage, hidden: Mask, window: float) -> RgbImage:
    """Return the colour of the sheet everywhere on `image`, uint8 [h, w, 3], where leaves hide it, too.

    It is the median in a window whose side is `window` times the shorter side of the image.
    """
    # It changes slowly: at half the size it takes a quarter of the time.
    half = tuple(max(1, side // 2) for side in hidden.shape[::-1])
    small = cv2.resize(image, half, interpolation=cv2.INTER_AREA)
    is_hidden = cv2.resize(hidden.astype(np.uint8), half, interpolation=cv2.INTER_AREA) > 0
    # OpenCV's large windows need 8 bits.
    side = min(MAX_MEDIAN_SIDE, int(window * min(half)) | 1)
    channels = cv2.split(_fill_from_around(small, is_hidden))
    sheet = np.dstack([cv2.medianBlur(channel, side) for channel in channels])
    return cv2.resize(sheet, hidden.shape[::-1], interpolation=cv2.INTER_LINEAR)


def _fill_from_around(image: RgbImage, hidden: Mask) -> RgbImage:
    """Return `image`, uint8 [h, w, 3], with the mean of what lies around where `hidden`, bool [h, w]."""
    visible = (~hidden).astype(np.float32)[..., np.newaxis]
    filled, side = image.copy(), 15
    # Wider and wider, until a window reaches beyond the largest leaf.
    while hidden.any() and side < 2 * max(hidden.shape):
        weight = cv2.blur(visible, (side, side))
        mean = cv2.blur(image * visible, (side, side)) / np.maximum(weight, 1e-6)[..., np.newaxis]
        reached = hidden & (weight > 0.1)
        filled[reached] = mean[reached].astype(np.uint8)
        hidden, side = hidden & ~reached, 2 * side + 1
    return filled
