"""Easy Leaf Area: leaf and a red square of known area by rules on colour, and the ratio of their pixels.

Easlon and Bloom (2014), "Easy Leaf Area: Automated digital image analysis for rapid and accurate measurement
of leaf area", Applications in Plant Sciences 2(7), 1400033; the paper's rule-based baseline. The rules, their
automatic setting and its constants (those for Arabidopsis, which the software starts with) are those of
github.com/heaslon/Easy-Leaf-Area, ela.py. Two things differ. What is too small for a leaf is left out, which
the software does when asked. And where the largest red thing is no square, it is not taken for the scale.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from laesi_tf.common.geometry import trace_largest_contour
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo, sort_in_reading_order
from laesi_tf.estimators.leaf_outline import CUT_OFF, PlacedMask, paint_masks
from laesi_tf.estimators.mask_estimator import NO_LEAF
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid

NAME = "rule_based"
"""What commands take in place of a training run."""
SQUARE_CM2 = 4.0
"""What the software takes a square for."""
_SQUARE, _GIVEN = "leaf colour x red square", "leaf colour x given scale"
_NO_SQUARE = "no red square found; lay one of 4 cm2 flat beside the leaf, well lit, or give px_per_mm"
_SAMPLED = 500
"""Pixels along the longer side that the rules are set on: an eighth of a photo's, as in the software."""
_ENOUGH = 0.0025
"""Share of the photo that is leaf or square for sure, by which the rules are set."""
_LEAST_LEAF = 500 / (1000 * 750)
"""Share of the photo below which something green is no leaf."""
_LEAST_SQUARE_PX = 25
_FULL, _LONG = 0.75, 1.6
"""Share of the box around it that a square fills at least, and the longest of its sides over the shortest."""


class Rule(NamedTuple):
    """A pixel belongs where its own colour is above `least`, and above `ratios` times the other two."""

    channel: int
    least: float
    ratios: tuple[float, float]

    def holds(self, image: np.ndarray) -> np.ndarray:
        """bool [...] for colours [..., 3]."""
        own, one, other = self.split(image)
        return (own > self.least) & (own > one * self.ratios[0]) & (own > other * self.ratios[1])

    def split(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The rule's channel and the other two, [...] each."""
        own, one, other = np.moveaxis(image.astype(np.float32), -1, 0)[[self.channel, *self.others]]
        return own, one, other

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
"""What is leaf, what is square for sure: ever wider until `_ENOUGH` pixels are."""


def fit_leaf_rule(sample: np.ndarray) -> Rule | None:
    """The rule for leaf pixels, set on a coarse picture uint8 [h, w, 3]; None where nothing is green."""
    found = _mean_colour(sample, _GREEN)
    if found is None:
        return None
    green, to_red, to_blue = found
    ratios = np.clip(0.360 * to_red + 0.589, 0.9, 2.0), np.clip(0.334 * to_blue + 0.534, 0.8, 2.0)
    return Rule(1, max(10.0, 1.223 * green - 111), (float(ratios[0]), float(ratios[1])))


def fit_square_rule(sample: np.ndarray) -> Rule | None:
    """The rule for the pixels of a red square, as `leaf_rule`; None where nothing is red."""
    found = _mean_colour(sample, _RED)
    if found is None:
        return None
    red, to_green, to_blue = found
    ratio = float(np.clip(0.134 * (to_green + to_blue) / 2 + 0.782, 1.01, 2.0))
    return Rule(0, float(np.clip(1.412 * red - 140.6, 0, 255)), (ratio, ratio))


def _mean_colour(sample: np.ndarray, rules: tuple[Rule, ...]) -> tuple[float, float, float] | None:
    """Mean of a channel and of its ratios to the others over the pixels that are in it for sure."""
    held = next(mask for rule in rules if (mask := rule.holds(sample)).mean() >= _ENOUGH or rule is rules[-1])
    if not held.any():
        return None
    own, one, other = rules[0].split(sample[held])
    # A ratio to nothing counts as one, as in the software.
    to_one, to_other = (np.divide(own, x, out=np.ones_like(own), where=x >= 1) for x in (one, other))
    return float(own.mean()), float(to_one.mean()), float(to_other.mean())


class EasyLeafArea:
    """Easy Leaf Area; it has learned nothing."""

    def __init__(self, square_cm2: float = SQUARE_CM2) -> None:
        """Take the area of the red square that lies in every photo."""
        self._square_mm2 = 100.0 * square_cm2

    def measure(self, image: np.ndarray, known: PhotoInfo = UNKNOWN) -> Measurement:
        """As `Estimator.measure`; a given scale serves where there is no square."""
        views = PhotoPyramid(image)
        leaf, square = _apply_rules(views.whole.image)
        parts = _find_leaf_components(leaf, views.whole)
        mask = paint_masks(parts, views.photo)
        red_px = _find_square(square) * float(np.prod(views.whole.step))
        method = _GIVEN if not red_px and known.px_per_mm else _SQUARE
        if not parts:
            return Measurement(method=method, mask=mask, refusal=NO_LEAF)
        scale = math.sqrt(red_px / self._square_mm2) or known.px_per_mm
        leaves = tuple(_measure_leaf(part, views.size, scale) for part in parts)
        refusal = _NO_SQUARE if scale is None else None
        return Measurement(method=method, leaves=leaves, mask=mask, refusal=refusal)


def _apply_rules(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """bool [h, w] each: where the leaf is, and where, beside it, red is."""
    step = max(1, round(max(image.shape[:2]) / _SAMPLED))
    sample, nothing = image[::step, ::step], np.zeros(image.shape[:2], bool)
    green, red = fit_leaf_rule(sample), fit_square_rule(sample)
    leaf = nothing if green is None else green.holds(image)
    return leaf, nothing if red is None else red.holds(image) & ~leaf


def _find_leaf_components(leaf: np.ndarray, cut: Crop) -> list[PlacedMask]:
    """The connected pieces of `leaf`, bool [h, w] over a cut, that are large enough, in reading order."""
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(leaf.astype(np.uint8), connectivity=4)
    least = _LEAST_LEAF * leaf.size
    large = [label for label in range(1, len(boxes)) if boxes[label, cv2.CC_STAT_AREA] >= least]
    parts = []
    for label in large:
        left, top, width, height = boxes[label, :4]
        box = slice(top, top + height), slice(left, left + width)
        part = Crop(cut.image[box], cut.to_photo(np.array([left, top])), cut.step)
        parts.append((part, labels[box] == label))
    ends = [(boxes[label, :2], boxes[label, :2] + boxes[label, 2:4]) for label in large]
    return [parts[index] for index in sort_in_reading_order(np.array(ends).reshape(-1, 2, 2))]


def _find_square(red: np.ndarray) -> int:
    """Pixels of the largest piece of `red`, bool [h, w]; 0 where it is no square."""
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(red.astype(np.uint8), connectivity=4)
    if len(boxes) == 1:
        return 0
    largest = 1 + int(np.argmax(boxes[1:, cv2.CC_STAT_AREA]))
    pixels = int(boxes[largest, cv2.CC_STAT_AREA])
    rows, columns = np.nonzero(labels == largest)
    _, sides, _ = cv2.minAreaRect(np.stack([columns, rows], axis=1).astype(np.float32))
    # Between the centres of the outermost pixels there is one pixel less than they cover.
    short, long = sorted(side + 1 for side in sides)
    square = pixels >= _LEAST_SQUARE_PX and pixels >= _FULL * short * long and long <= _LONG * short
    return pixels if square else 0


def _measure_leaf(part: PlacedMask, size: np.ndarray, px_per_mm: float | None) -> LeafMeasurement:
    """A leaf on a photo of `size`, width and height: its green pixels times what one covers, if known."""
    cut, piece = part
    pixels = float(np.count_nonzero(piece) * np.prod(cut.step))
    ends = cut.to_photo(np.array([[0, 0], piece.shape[::-1]]))
    inside = (ends[0] > 0.5).all() and (ends[1] < size - 0.5).all()
    return LeafMeasurement(
        area_cm2=None if px_per_mm is None else pixels / px_per_mm**2 / 100,
        px_per_mm=px_per_mm,
        outline=cut.to_photo(trace_largest_contour(piece) + 0.5) - 0.5,
        note=None if inside else CUT_OFF,
    )
