"""Easy Leaf Area: leaf and a red square of known area by colour rules; the area is a ratio of pixels.

Easlon and Bloom (2014), "Easy Leaf Area: Automated digital image analysis for rapid and accurate measurement
of leaf area", Applications in Plant Sciences 2(7), 1400033; the paper's rule-based baseline. The rules, their
automatic setting and its constants (those for Arabidopsis, the software's defaults) are those of
github.com/heaslon/Easy-Leaf-Area, ela.py. Two things differ: components too small for a leaf are left out,
which is an option of the software, and the largest red component is the scale only if it is a square.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from laesi_tf.common.arrays import FloatMap, Mask, RgbImage
from laesi_tf.common.geometry import pixel_centres, trace_polygons
from laesi_tf.estimators.base import (
    UNKNOWN,
    LeafMeasurement,
    Measurement,
    PhotoInfo,
    sort_in_reading_order,
)
from laesi_tf.estimators.leaf_outline import CUT_OFF, PlacedMask, paint_masks
from laesi_tf.estimators.mask_estimator import NO_LEAF
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid

_BY_SQUARE, _BY_GIVEN_SCALE = "leaf colour x red square", "leaf colour x given scale"
_NO_SQUARE = (
    "no red square found; place one of 4 cm2 flat beside the leaf, well lit, or give the scale with "
    "--px-per-mm (in a manifest: column px_per_mm)"
)


@dataclass(frozen=True, kw_only=True)
class EasyLeafAreaParams:
    """Parameters of Easy Leaf Area that are not constants of its colour rules."""

    square_cm2: float = parameter(4.0, unit="cm2", set_on="the software's default")
    """Area of the red square."""
    sample_side_px: int = parameter(
        500, unit="pixels", set_on="an eighth of a photo's side, as in the software"
    )
    """Longer side of the reduced image that the rules are fitted to."""
    min_sample_share: float = parameter(0.0025, unit="share of the image", set_on="ela.py")
    """Share of pixels by which a rule is fitted."""
    min_leaf_share: float = parameter(
        500 / (1000 * 750), unit="share of the photo", set_on="ela.py, an option"
    )
    """Smaller green components are no leaves."""
    min_square_px: float = parameter(25.0, unit="overview pixels")
    """Smaller red components are no squares."""
    min_square_fill: float = parameter(0.75, unit="share of the box")
    """A square fills at least so much of the box around it."""
    max_square_aspect: float = parameter(1.6, unit="longer over shorter side")
    """A square in perspective is at most so oblong."""


class Rule(NamedTuple):
    """A colour rule: `channel` is above `least`, and above `ratios` times the other two channels."""

    channel: int
    least: float
    ratios: tuple[float, float]

    def matches(self, image: RgbImage) -> Mask:
        """Return bool [...] for colours [..., 3]."""
        own, first, second = self.split(image)
        return (own > self.least) & (own > first * self.ratios[0]) & (own > second * self.ratios[1])

    def split(self, image: RgbImage) -> tuple[FloatMap, FloatMap, FloatMap]:
        """Return the rule's channel and the other two, float32 [...] each."""
        own, first, second = np.moveaxis(image.astype(np.float32), -1, 0)[[self.channel, *self.others]]
        return own, first, second

    @property
    def others(self) -> tuple[int, int]:
        """The other two channels: red and blue for green, green and blue for red."""
        return (1, 2) if self.channel == 0 else (0, 2)


_GREEN = tuple(
    Rule(1, 75 * 0.9 ** max(0, step - 12), (2.0 * 0.94 ** min(step, 12), 1.8 * 0.94 ** min(step, 12)))
    for step in range(17)
)
_RED = (
    *(Rule(0, 150, (2.0 * 0.94**step,) * 2) for step in range(8)),
    *(Rule(0, 150 * 0.99**step, (2.0, 2.0)) for step in range(1, 4)),
)
"""Rules for certain leaf and certain square, strict to permissive; the first with enough pixels is used."""


def fit_leaf_rule(sample: RgbImage, min_share: float = EasyLeafAreaParams.min_sample_share) -> Rule | None:
    """Fit the rule for leaf pixels to a reduced image, uint8 [h, w, 3]; None where nothing is green."""
    found = _average_colour(sample, _GREEN, min_share)
    if found is None:
        return None
    green, to_red, to_blue = found
    ratios = np.clip(0.360 * to_red + 0.589, 0.9, 2.0), np.clip(0.334 * to_blue + 0.534, 0.8, 2.0)
    return Rule(1, max(10.0, 1.223 * green - 111), (float(ratios[0]), float(ratios[1])))


def fit_square_rule(sample: RgbImage, min_share: float = EasyLeafAreaParams.min_sample_share) -> Rule | None:
    """Fit the rule for pixels of a red square as `fit_leaf_rule` does; None where nothing is red."""
    found = _average_colour(sample, _RED, min_share)
    if found is None:
        return None
    red, to_green, to_blue = found
    ratio = float(np.clip(0.134 * (to_green + to_blue) / 2 + 0.782, 1.01, 2.0))
    return Rule(0, float(np.clip(1.412 * red - 140.6, 0, 255)), (ratio, ratio))


def _average_colour(
    sample: RgbImage, rules: tuple[Rule, ...], min_share: float
) -> tuple[float, float, float] | None:
    """Return the means of the rules' channel and of its ratios to the others over matching pixels."""
    masks = (rule.matches(sample) for rule in rules)
    mask = next((mask for mask in masks if mask.mean() >= min_share), rules[-1].matches(sample))
    if not mask.any():
        return None
    own, first, second = rules[0].split(sample[mask])
    # A ratio to nothing counts as one, as in the software.
    to_first, to_second = (np.divide(own, x, out=np.ones_like(own), where=x >= 1) for x in (first, second))
    return float(own.mean()), float(to_first.mean()), float(to_second.mean())


class EasyLeafArea:
    """Measures by colour rules; nothing is learned."""

    def __init__(self, params: EasyLeafAreaParams | None = None) -> None:
        """Take other parameters than the software's."""
        self.params = params or EasyLeafAreaParams()

    def with_params(self, params: EasyLeafAreaParams) -> "EasyLeafArea":
        """Return an estimator with other parameters."""
        return EasyLeafArea(params)

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`; a given scale is used where there is no square."""
        pyramid = PhotoPyramid(image)
        leaf_mask, red_mask = self._apply_rules(pyramid.overview.image)
        components = self._find_leaf_components(leaf_mask, pyramid.overview)
        mask = paint_masks(components, pyramid.photo)
        square_px = self._find_square(red_mask) * float(np.prod(pyramid.overview.pixel_size))
        method = _BY_GIVEN_SCALE if not square_px and info.px_per_mm else _BY_SQUARE
        if not components:
            return Measurement(method=method, mask=mask, refusal=NO_LEAF)
        px_per_mm = math.sqrt(square_px / (100 * self.params.square_cm2)) or info.px_per_mm
        leaves = tuple(_measure_leaf(component, pyramid, px_per_mm) for component in components)
        refusal = _NO_SQUARE if px_per_mm is None else None
        return Measurement(method=method, leaves=leaves, mask=mask, refusal=refusal)

    def _apply_rules(self, image: RgbImage) -> tuple[Mask, Mask]:
        """Return masks, bool [h, w] each, of leaf pixels and of red pixels that are not leaf."""
        step = max(1, round(max(image.shape[:2]) / self.params.sample_side_px))
        sample, nothing = image[::step, ::step], np.zeros(image.shape[:2], bool)
        green = fit_leaf_rule(sample, self.params.min_sample_share)
        red = fit_square_rule(sample, self.params.min_sample_share)
        leaf_mask = nothing if green is None else green.matches(image)
        return leaf_mask, nothing if red is None else red.matches(image) & ~leaf_mask

    def _find_leaf_components(self, leaf_mask: Mask, crop: Crop) -> list[PlacedMask]:
        """Return the components of `leaf_mask`, bool [h, w] over a crop, large enough, in reading order."""
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(leaf_mask.astype(np.uint8), connectivity=4)
        least = self.params.min_leaf_share * leaf_mask.size
        large = [label for label in range(1, len(boxes)) if boxes[label, cv2.CC_STAT_AREA] >= least]
        components = []
        for label in large:
            left, top, width, height = boxes[label, :4]
            box = slice(top, top + height), slice(left, left + width)
            part = Crop(crop.image[box], crop.to_photo(np.array([left, top])), crop.pixel_size)
            components.append((part, labels[box] == label))
        corners = [(boxes[label, :2], boxes[label, :2] + boxes[label, 2:4]) for label in large]
        order = sort_in_reading_order(np.array(corners).reshape(-1, 2, 2))
        return [components[index] for index in order]

    def _find_square(self, red_mask: Mask) -> int:
        """Return the pixels of the largest component of `red_mask`, bool [h, w]; 0 if it is no square."""
        params = self.params
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(red_mask.astype(np.uint8), connectivity=4)
        if len(boxes) == 1:
            return 0
        largest = 1 + int(np.argmax(boxes[1:, cv2.CC_STAT_AREA]))
        pixels = int(boxes[largest, cv2.CC_STAT_AREA])
        _, sides, _ = cv2.minAreaRect(pixel_centres(labels == largest).astype(np.float32))
        # The box around pixel centres is one pixel narrower than that around the pixels.
        short, long = sorted(side + 1 for side in sides)
        is_filled = pixels >= params.min_square_fill * short * long
        is_square = is_filled and long <= params.max_square_aspect * short
        return pixels if is_square and pixels >= params.min_square_px else 0


def _measure_leaf(component: PlacedMask, pyramid: PhotoPyramid, px_per_mm: float | None) -> LeafMeasurement:
    """Measure a component: the photo pixels it covers times the area of one, if the scale is known."""
    crop, mask = component
    pixels = float(np.count_nonzero(mask) * np.prod(crop.pixel_size))
    end = crop.to_photo(crop.size.xy)
    is_whole = (crop.origin > 0.5).all() and (end < pyramid.size.xy - 0.5).all()
    return LeafMeasurement(
        area_cm2=None if px_per_mm is None else pixels / px_per_mm**2 / 100,
        px_per_mm=px_per_mm,
        outline=np.clip(crop.to_photo(trace_polygons(mask)[0].outer), 0, pyramid.size.xy),
        note=None if is_whole else CUT_OFF,
    )
