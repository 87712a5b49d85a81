"""Outlines of leaves at the photo's resolution, and masks painted from them."""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, Points
from laesi_tf.common.geometry import (
    ImageSize,
    Polygon,
    polygon_area,
    polygon_centroid,
    polygon_perimeter,
    trace_polygons,
)
from laesi_tf.estimators.base import LeafMeasurement
from laesi_tf.estimators.leaf_candidates import LeafCandidate
from laesi_tf.estimators.leaf_shape import measure_polygon
from laesi_tf.estimators.leaf_surroundings import SurroundingsParams, is_touched
from laesi_tf.estimators.mask_refinement import MaskRefinementParams, refine_mask
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.petiole_chain import PetioleChainParams, find_chain
from laesi_tf.estimators.photo_pyramid import Crop
from laesi_tf.estimators.sheet_map import SheetMap

CUT_OFF = "cut off by the photo's border: at least this much"
TOUCHED = "something other than bare paper touches it: look whether a part is covered or left out"
HIDDEN_MARGIN = "its margin has the paper's colour and is known by the lines it hides: look at the outline"

UNCERTAINTY_SET = (
    "rendered (split develop, visible areas) and every 8th photo of semi-real's train: 68 and 95 % of the "
    "areas within one and two standard deviations; 2026-11-29"
)
"""What the parameters of uncertainty were set on."""

PlacedMask = tuple[Crop, Mask]
"""A leaf as a mask, bool [h, w], in a crop of the photo."""


@dataclass(frozen=True, kw_only=True)
class LeafOutlineParams:
    """Parameters of outlines."""

    refinement: MaskRefinementParams = field(default_factory=MaskRefinementParams)
    petiole: PetioleChainParams = field(default_factory=PetioleChainParams)
    surroundings: SurroundingsParams = field(default_factory=SurroundingsParams)
    min_area_px: float = parameter(50.0, unit="photo pixels")
    """Smaller leaves cannot be measured."""
    border_px: float = parameter(1.5, unit="pixels of the crop")
    """A leaf that comes so close to the photo's border is assumed to continue beyond it."""
    pen_max_aspect: float = parameter(
        0.2, unit="width over length", set_on="drawn pens and ellipses, 2026-11-25"
    )
    """A pen is at most so wide."""
    pen_min_fill: float = parameter(
        0.8, unit="share of the box", set_on="the area of an ellipse is 0.785 of its box; 2026-11-25"
    )
    """A pen fills at least so much of its box; slender leaves taper."""
    note_min_fill: float = parameter(
        0.93, unit="share of the box", set_on="rendered (split develop) and cases, 2026-11-29"
    )
    """A note or a label fills at least so much of its box."""
    coin_max_deviation: float = parameter(
        0.03, unit="radii", set_on="rendered (split develop) and cases, 2026-11-29"
    )
    """Standard deviation of a coin's outline from an ellipse, at most."""
    coin_min_aspect: float = parameter(0.75, unit="width over length", set_on="a tilt of 40 degrees")
    """A coin is at least so round; leaflets are longer."""
    error_sd: float = parameter(1.0, unit="expected errors", set_on=UNCERTAINTY_SET)
    """Standard deviation of the area per expected misclassified pixel."""
    edge_sd_px: float = parameter(0.06, unit="pixels of the crop", set_on=UNCERTAINTY_SET)
    """Standard deviation of the position of the whole outline, from the sampling of pixels."""
    edge_sd_mm: float = parameter(0.02, unit="mm", set_on=UNCERTAINTY_SET)
    """The same on the sheet, from margins that curl, shine or lie in shadow."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafOutline:
    """A leaf's outline in photo pixels."""

    crop: Crop
    mask: Mask
    """bool [h, w], the leaf in the crop."""
    polygon: Polygon
    """Its outline and holes in photo pixels."""
    area_sd_px: float
    """Standard deviation of the area in photo pixels, without `edge_sd_mm`."""
    edge_sd_mm: float
    """Standard deviation of the position of the outline on the sheet."""
    is_cut_off: bool
    """Whether it reaches the photo's border."""
    is_touched: bool
    """Whether something other than paper touches it."""
    has_hidden_margin: bool = False
    """Whether it includes a margin that has the paper's colour."""
    candidate: LeafCandidate | None = None
    """What the network saw of it, where there is one."""

    @property
    def placed_mask(self) -> PlacedMask:
        """Mask and position, for `paint_masks`."""
        return self.crop, self.mask

    def without_scale(self) -> LeafMeasurement:
        """Return what is known of the leaf without a scale: its outline."""
        reasons = {CUT_OFF: self.is_cut_off, TOUCHED: self.is_touched, HIDDEN_MARGIN: self.has_hidden_margin}
        notes = [note for note, holds in reasons.items() if holds]
        return LeafMeasurement(
            outline=self.polygon.outer, holes=self.polygon.holes, note="; ".join(notes) or None
        )

    @property
    def area_px(self) -> float:
        """What the outer contour encloses in photo pixels, holes included."""
        return abs(polygon_area(self.polygon.outer))

    @property
    def centroid(self) -> Points:
        """Centroid [2] of what the outer contour encloses, photo pixels."""
        return polygon_centroid(self.polygon.outer)

    def measure(self, sheet_map: SheetMap) -> LeafMeasurement:
        """Measure the leaf where `sheet_map` says that it lies on the sheet."""
        outer, *holes = (sheet_map.to_sheet(ring) for ring in self.polygon.rings)
        shape = measure_polygon(Polygon(outer, tuple(holes)))
        px_per_mm = sheet_map.px_per_mm(self.centroid)
        area_sd_mm2 = np.hypot(self.area_sd_px / px_per_mm**2, self.edge_sd_mm * shape.perimeter)
        return dataclasses.replace(
            self.without_scale(),
            area_cm2=shape.area / 100,
            uncertainty_cm2=float(area_sd_mm2) / 100,
            px_per_mm=px_per_mm,
            length_mm=shape.length,
            width_mm=shape.width,
            perimeter_mm=shape.perimeter,
            holes_cm2=shape.holes / 100,
        )


def outline_leaf(candidate: LeafCandidate, size: ImageSize, params: LeafOutlineParams) -> LeafOutline | None:
    """Outline a leaf at the resolution of its crop of a photo of `size`; None if it is too small."""
    return _outline(candidate, None, size, params)


def add_petiole(outline: LeafOutline, size: ImageSize, params: LeafOutlineParams) -> LeafOutline:
    """Return `outline` with the petiole that the network sees as a chain in a photo of `size`.

    Whether a thing is a leaf must have been decided: printed lines beside a coin look like a chain, too.
    """
    if outline.candidate is None or outline.has_hidden_margin:
        return outline
    chain = find_chain(outline.candidate, params.petiole)
    if chain is None:
        return outline
    extended = _outline(outline.candidate, chain, size, params)
    return outline if extended is None else dataclasses.replace(extended, is_touched=outline.is_touched)


def _outline(
    candidate: LeafCandidate, chain: Mask | None, size: ImageSize, params: LeafOutlineParams
) -> LeafOutline | None:
    """Outline a leaf, with the petiole of `chain`, bool [h, w] in the network's input, if there is one."""
    crop, letterbox = candidate.crop, candidate.letterbox

    def enlarge(mask: Mask) -> Mask:
        enlarged: Mask = letterbox.crop_and_resize_back(mask.astype(np.float32)) >= 0.5
        return enlarged

    others, own = enlarge(candidate.other_leaves_mask()), candidate.own_probability()
    if chain is not None:
        own = np.where(chain, np.maximum(candidate.probability, params.petiole.raised_probability), own)
    network_px = 1 / float(letterbox.scale.min())
    refined = refine_mask(
        crop.image,
        letterbox.crop_and_resize_back(own),
        network_px,
        others=others,
        petiole=None if chain is None else enlarge(chain),
        params=params.refinement,
    )
    polygons = trace_polygons(refined.mask)
    if not polygons:
        return None
    largest = polygons[0]
    area_sd = np.hypot(
        params.error_sd * refined.expected_errors_px, params.edge_sd_px * polygon_perimeter(largest.outer)
    )
    outer, *holes = (crop.to_photo(ring) for ring in largest.rings)
    margin = params.border_px * crop.pixel_size
    is_cut_off = bool((outer <= margin).any() or (outer >= size.xy - margin).any())
    polygon = Polygon(np.clip(outer, 0.5, size.xy - 0.5), tuple(holes))
    if measure_polygon(polygon).area < params.min_area_px:
        return None
    return LeafOutline(
        crop=crop,
        mask=refined.mask,
        polygon=polygon,
        area_sd_px=float(area_sd * crop.pixel_size.prod()),
        edge_sd_mm=params.edge_sd_mm,
        is_cut_off=is_cut_off,
        is_touched=is_touched(crop.image, refined.mask, others, network_px, params.surroundings),
        candidate=candidate,
    )


def looks_like_pen(outline: Points, params: LeafOutlineParams) -> bool:
    """Return whether `outline` [N, 2] is a pen's rather than a leaf's: slender, and it fills its box."""
    points = outline.astype(np.float32)
    _, sides, _ = cv2.minAreaRect(points)
    is_slender = min(sides) < params.pen_max_aspect * max(sides)
    return is_slender and cv2.contourArea(points) > params.pen_min_fill * sides[0] * sides[1]


def looks_like_note(outline: Points, params: LeafOutlineParams) -> bool:
    """Return whether `outline` [N, 2] is a rectangle, as of a note or a label."""
    points = outline.astype(np.float32)
    _, sides, _ = cv2.minAreaRect(points)
    return cv2.contourArea(points) > params.note_min_fill * sides[0] * sides[1]


def looks_made(outline: Points, params: LeafOutlineParams) -> bool:
    """Return whether `outline` [N, 2] has the shape of a pen or a note rather than of a leaf."""
    return looks_like_pen(outline, params) or looks_like_note(outline, params)


def looks_like_coin(outline: Points, params: LeafOutlineParams) -> bool:
    """Return whether `outline` [N, 2] is an ellipse, as of a coin."""
    if len(outline) < 20:
        return False
    middle, axes, angle = cv2.fitEllipse(outline.astype(np.float32))
    if min(axes) < params.coin_min_aspect * max(axes):
        return False
    turn = np.deg2rad(angle)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    radii = np.linalg.norm((outline - middle) @ rotation / (np.maximum(axes, 1e-6) / 2), axis=1)
    return bool(radii.std() < params.coin_max_deviation)


def paint_masks(masks: Iterable[PlacedMask], target: Crop) -> Mask:
    """Return a mask, bool [H, W], of all leaves in `target`, a crop of the same photo."""
    painted = np.zeros(target.size, bool)
    for crop, mask in masks:
        corners = target.from_photo(crop.to_photo(np.stack([np.zeros(2), ImageSize.of(mask).xy])))
        (left, top), (right, bottom) = np.round(corners).astype(int)
        size = max(1, right - left), max(1, bottom - top)
        region = painted[top : top + size[1], left : left + size[0]]
        # Interpolated, with the threshold halfway, the edge moves to neither side.
        resized = cv2.resize(mask.astype(np.uint8) * 255, size, interpolation=cv2.INTER_LINEAR)
        region |= resized[: region.shape[0], : region.shape[1]] >= 128
    return painted
