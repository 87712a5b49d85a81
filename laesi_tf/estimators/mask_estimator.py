"""Measure each leaf as the area of its mask times a scale that is given; a network predicts the masks."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from laesi_tf.common.arrays import RgbImage
from laesi_tf.estimators.base import UNKNOWN, Measurement, PhotoInfo, sort_in_reading_order
from laesi_tf.estimators.leaf_candidates import LeafCandidate, LeafDetectorParams
from laesi_tf.estimators.leaf_colour import LeafColourParams, ThingColour, measure_colour
from laesi_tf.estimators.leaf_detector import LeafDetector, MaskPredictor
from laesi_tf.estimators.leaf_outline import (
    LeafOutline,
    LeafOutlineParams,
    add_petiole,
    looks_like_coin,
    looks_made,
    outline_leaf,
    paint_masks,
)
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.sheet_map import UniformScale

METHOD = "mask x given scale"
NO_LEAF = "no leaf found; show one whole leaf on the paper"
NO_SCALE = (
    "a mask model alone measures no scale; give it with --px-per-mm (in a manifest: column px_per_mm), or "
    "name it with --mask-model, so that the ruling is read"
)


@dataclass(frozen=True, kw_only=True)
class MaskEstimatorParams:
    """Parameters of the mask estimator's stages."""

    detector: LeafDetectorParams = field(default_factory=LeafDetectorParams)
    outline: LeafOutlineParams = field(default_factory=LeafOutlineParams)
    speck: float = parameter(0.1, unit="share of the coin", set_on="phone scenes of seed 81, 2026-12-01")
    """A green thing smaller than this is not the leaf that a coin lies beside."""


class MaskEstimator:
    """Measures with a mask network; refuses the areas where no scale is given."""

    def __init__(
        self, predict: MaskPredictor, input_size: tuple[int, int], params: MaskEstimatorParams | None = None
    ) -> None:
        """Take a mask network and the (height, width) of its input."""
        self.params = params or MaskEstimatorParams()
        self._input_size = input_size
        self._predict = predict
        self._detector = LeafDetector(self._predict, input_size, self.params.detector)

    def with_params(self, params: MaskEstimatorParams) -> "MaskEstimator":
        """Return an estimator with the same network and other parameters."""
        changed = copy.copy(self)
        changed.params = params
        changed._detector = LeafDetector(self._predict, self._input_size, params.detector)
        return changed

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`; a refusal for want of a scale has a mask and outlines."""
        pyramid = PhotoPyramid(image)
        outlines = self.add_petioles(self.outline_leaves(self.detect_leaves(pyramid), pyramid), pyramid)
        mask = paint_masks((outline.placed_mask for outline in outlines), pyramid.photo)
        if not outlines:
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        if info.px_per_mm is None:
            leaves = tuple(outline.without_scale() for outline in outlines)
            return Measurement(method=METHOD, leaves=leaves, mask=mask, refusal=NO_SCALE)
        scale = UniformScale(info.px_per_mm)
        leaves = tuple(outline.measure(scale) for outline in outlines)
        return Measurement(method=METHOD, leaves=leaves, mask=mask)

    def detect_leaves(self, pyramid: PhotoPyramid) -> list[LeafCandidate]:
        """Return the leaves on a photo at the network's resolution, the largest first."""
        return self._detector.find_leaves(pyramid)

    def outline_leaves(self, candidates: Sequence[LeafCandidate], pyramid: PhotoPyramid) -> list[LeafOutline]:
        """Outline detected leaves at the photo's resolution, in reading order.

        Pens, notes and black strokes are left out, unless there is nothing else, and coins beside a larger
        leaf: cuttings of leaves are round, too.
        """
        params = self.params.outline
        outlined = (outline_leaf(candidate, pyramid.size, params) for candidate in candidates)
        outlines = [outline for outline in outlined if outline is not None]
        if len(outlines) > 1:
            leaves = [outline for outline in outlines if not looks_made(outline.polygon.outer, params)]
            outlines = leaves or outlines
        if len(outlines) > 1:
            outlines = self._leave_out_coins(self._leave_out_strokes(outlines))
        contours = [outline.polygon.outer for outline in outlines]
        boxes = np.array([[contour.min(axis=0), contour.max(axis=0)] for contour in contours])
        return [outlines[index] for index in sort_in_reading_order(boxes.reshape(-1, 2, 2))]

    def add_petioles(self, outlines: Sequence[LeafOutline], pyramid: PhotoPyramid) -> list[LeafOutline]:
        """Return `outlines`, all of them leaves, with petioles that are too thin for the network."""
        return [add_petiole(outline, pyramid.size, self.params.outline) for outline in outlines]

    def _leave_out_strokes(self, outlines: list[LeafOutline]) -> list[LeafOutline]:
        """Return `outlines` without those that are black, unless all are."""
        colour = self.params.detector.colour
        leaves = [outline for outline in outlines if not _measure_colour(outline, colour).is_black(colour)]
        return leaves or outlines

    def _leave_out_coins(self, outlines: list[LeafOutline]) -> list[LeafOutline]:
        """Return `outlines` without coins: round, not green, and smaller than the largest of the others, or
        beside one of them that is green and not a mere speck."""
        is_coin = [looks_like_coin(outline.polygon.outer, self.params.outline) for outline in outlines]
        if not any(is_coin):
            return outlines
        others = [outline for outline, coin in zip(outlines, is_coin, strict=True) if not coin]
        largest = max((other.area_px for other in others), default=0.0)

        def is_green(outline: LeafOutline) -> bool:
            colour = self.params.detector.colour
            return _measure_colour(outline, colour).is_green(colour)

        largest_green = max((other.area_px for other in others if is_green(other)), default=0.0)

        def is_leaf(outline: LeafOutline) -> bool:
            is_larger = outline.area_px >= max(largest, largest_green / self.params.speck)
            return is_larger or is_green(outline)

        return [
            outline for outline, coin in zip(outlines, is_coin, strict=True) if not coin or is_leaf(outline)
        ]


def _measure_colour(outline: LeafOutline, params: LeafColourParams) -> ThingColour:
    return measure_colour(outline.crop.image, outline.mask, params)
