"""The objects on a plain background: where they are, and which of them are no leaves."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask
from laesi_tf.estimators.leaf_outline import LeafOutlineParams, looks_like_coin, looks_like_note
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop
from laesi_tf.estimators.scan.plain_background import DRAWN_SCANS, PlainBackground

_MARGIN_PX = 4


@dataclass(frozen=True, kw_only=True)
class ScanObjectParams:
    """Parameters of objects."""

    outline: LeafOutlineParams = field(default_factory=LeafOutlineParams)
    reach_px: int = parameter(5, unit="pixels", set_on=DRAWN_SCANS)
    """How far from an edge the colour of the object is looked for."""
    band_px: float = parameter(3.0, unit="pixels", set_on=DRAWN_SCANS)
    """Pixels so close to the background are mixed with it: half the difference decides."""
    min_area_px: float = parameter(50.0, unit="pixels", set_on=DRAWN_SCANS)
    """Smaller objects are dust."""
    min_area_mm2: float = parameter(2.0, unit="mm2", set_on="cotyledons of Arabidopsis have 3; 2026-11-29")
    """The same on the sheet."""
    min_chroma: float = parameter(8.0, unit="CIELAB", set_on=DRAWN_SCANS)
    """Colours of less chroma are black, grey or white."""
    max_red_chroma: float = parameter(60.0, unit="CIELAB", set_on="print and autumn leaves, 2026-11-29")
    """Redder than leaves of autumn."""
    leaf_hues: tuple[float, float] = parameter((-30.0, 185.0), unit="degrees", set_on="purple to blue-green")
    """Hues of leaves in CIELAB: 0 is magenta, 90 yellow, 180 green, -90 blue."""
    ruling_span: float = parameter(0.5, unit="share of the sides", set_on="rendered and cases, 2026-11-29")
    """A ruling spans so much of the image."""
    ruling_fill: float = parameter(0.25, unit="share of its box", set_on="rendered and cases, 2026-11-29")
    """It fills at most so much of its box."""
    sheet_share: float = parameter(0.15, unit="share of the image", set_on="rendered and cases, 2026-11-29")
    """A sheet of paper has at least so much of the image."""
    most_of_image: float = parameter(0.4, unit="share of the image", set_on="rendered, 2026-11-29")
    """No leaf has so much of a scan."""
    uniform_sd: float = parameter(9.0, unit="levels of 255", set_on=DRAWN_SCANS)
    """Print, plastic and card vary at most so much."""


@dataclass(frozen=True, eq=False)
class ScanObject:
    """An object."""

    crop: Crop
    """Its part of the scan at working scale."""
    mask: Mask
    """bool [h, w], the object in the crop."""
    touches_border: bool
    """Whether it reaches the border of the scan."""


def find_objects(
    working: Crop, background: PlainBackground, params: ScanObjectParams, *, px_per_mm: float
) -> Iterator[ScanObject]:
    """Yield the objects on a whole scan at working scale, each large enough to be a leaf.

    `px_per_mm` is the working scale.
    """
    difference, is_shadow = background.compare(working.image)
    mask = _segment(difference, is_shadow, background.threshold, params)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    least = max(params.min_area_px, params.min_area_mm2 * px_per_mm**2)
    height, width = mask.shape
    for label in range(1, count):
        left, top, wide, tall, area = map(int, statistics[label])
        if area < least:
            continue
        rows = slice(max(0, top - _MARGIN_PX), min(height, top + tall + _MARGIN_PX))
        columns = slice(max(0, left - _MARGIN_PX), min(width, left + wide + _MARGIN_PX))
        own = labels[rows, columns] == label
        origin = working.to_photo(np.array([columns.start, rows.start], float))
        yield ScanObject(
            Crop(working.image[rows, columns], origin, working.pixel_size),
            _fill_marked_holes(own, difference[rows, columns], background.threshold),
            left <= 1 or top <= 1 or left + wide >= width - 1 or top + tall >= height - 1,
        )


def is_leaf_like(found: ScanObject, outline: NDArray[np.float64], params: ScanObjectParams) -> bool:
    """Return whether an object may be a leaf, by its colour and, where that is no leaf's, its shape.

    Grey, black, white, blue and bright red objects are no leaves if they have one colour, if they are
    rectangles or discs, or if the border cuts them off, as the lid of a scanner.
    """
    colour, sd = _measure_colour(found)
    if _has_leaf_colour(colour, params):
        return True
    is_plain = sd < params.uniform_sd or is_geometric(outline, params)
    return not is_plain and not found.touches_border


def is_sheet_or_ruling(
    found: ScanObject, outline: NDArray[np.float64], whole: Crop, params: ScanObjectParams
) -> bool:
    """Return whether an object shows that the background is none: a sheet on a desk, or a ruling.

    A sheet is large, and a rectangle or of no leaf's colour, or covers most of the image; a ruling spans the
    image and fills little of it.
    """
    height, width = found.mask.shape
    area = np.count_nonzero(found.mask)
    spans = min(width / whole.image.shape[1], height / whole.image.shape[0])
    if spans > params.ruling_span and area < params.ruling_fill * width * height:
        return True
    share = area / (whole.image.shape[0] * whole.image.shape[1])
    if share < params.sheet_share or share > params.most_of_image:
        return share > params.most_of_image
    return is_geometric(outline, params) or not is_leaf_like(found, outline, params)


def is_geometric(outline: NDArray[np.float64], params: ScanObjectParams) -> bool:
    """Return whether an outline [N, 2] is a rectangle or an ellipse."""
    return looks_like_note(outline, params.outline) or looks_like_coin(outline, params.outline)


def has_one_colour(found: ScanObject, params: ScanObjectParams) -> bool:
    """Return whether an object varies less in colour than leaves do."""
    return _measure_colour(found)[1] < params.uniform_sd


def _segment(
    difference: NDArray[np.uint8], is_shadow: Mask, threshold: float, params: ScanObjectParams
) -> NDArray[np.uint8]:
    """Return the pixels of objects, uint8 [H, W] 0/1.

    An edge lies halfway between the differences of the object and of what is beside it: a shadow, perhaps.
    """
    marked = ((difference > threshold) & ~is_shadow).astype(np.uint8)
    window = np.ones((2 * params.reach_px + 1,) * 2, np.uint8)
    smooth = cv2.medianBlur(difference, 3)
    # Halves are added, as the sum of two levels can exceed 255.
    halfway = cv2.dilate(smooth, window) // 2 + cv2.erode(smooth, window) // 2
    is_inside = cv2.distanceTransform(marked, cv2.DIST_L2, 3) > params.band_px
    return marked & (is_inside | (difference > halfway)).astype(np.uint8)


def _fill_marked_holes(mask: Mask, difference: NDArray[np.uint8], threshold: float) -> Mask:
    """Return `mask`, bool [h, w], without the holes that differ from the background: pale veins, gloss."""
    count, labels, statistics, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    filled = mask.copy()
    for label in range(1, count):
        left, top, width, height, _ = statistics[label]
        if left == 0 or top == 0 or left + width == mask.shape[1] or top + height == mask.shape[0]:
            continue
        box = slice(top, top + height), slice(left, left + width)
        hole = labels[box] == label
        if difference[box][hole].mean() > threshold:
            filled[box] |= hole
    return filled


def _measure_colour(found: ScanObject) -> tuple[NDArray[np.float64], float]:
    """Return the median colour of an object in CIELAB [3] and the standard deviation of its RGB levels."""
    core = cv2.erode(found.mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    pixels = found.crop.image[core if core.any() else found.mask]
    colour = np.median(pixels, axis=0).astype(np.float32).reshape(1, 1, 3) / 255
    lab: FloatMap = cv2.cvtColor(colour, cv2.COLOR_RGB2LAB)
    return lab.reshape(3).astype(np.float64), float(pixels.std(axis=0).mean())


def _has_leaf_colour(lab: NDArray[np.float64], params: ScanObjectParams) -> bool:
    chroma = float(np.hypot(lab[1], lab[2]))
    hue = float(np.rad2deg(np.arctan2(lab[2], lab[1])))
    low, high = params.leaf_hues
    is_red = -45 < hue < 60
    is_in_range = low <= hue <= high or hue + 360 <= high
    return chroma >= params.min_chroma and is_in_range and not (is_red and chroma > params.max_red_chroma)
