"""Outlines of leaves in photo pixels, and masks painted from them."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.geometry import apply_homography, compute_px_per_mm, polygon_centroid, trace_polygons
from laesi_tf.estimators.base import LeafMeasurement
from laesi_tf.estimators.leaf_detector import LeafCandidate
from laesi_tf.estimators.leaf_shape import measure_polygon
from laesi_tf.estimators.mask_refinement import refine_mask
from laesi_tf.estimators.photo_pyramid import Crop

CUT_OFF = "cut off by the photo's border: at least this much"
_BORDER_PX = 1.5
"""A leaf that comes this close to the photo's border is taken to go on beyond it."""
_SLENDER, _STRAIGHT = 0.2, 0.8
"""Width over length of a rod at most, and the share of its box that it fills at least."""
_DOUBT, _MARGIN_PX = 0.8, 0.16
"""Standard deviations of a silhouette's area, in doubtful pixels and in pixels of its margin: two thirds of
semi-real photographs, whose leaves lie flat, are within what they and `reading._SCALE_FLOOR` give."""


@dataclass(frozen=True, eq=False)
class LeafOutline:
    """A leaf's silhouette in photo pixels, their centres at halves."""

    cut: Crop
    mask: np.ndarray
    """bool [h, w], the leaf in the cut."""
    margin: np.ndarray
    """[N, 2] outer contour."""
    holes: tuple[np.ndarray, ...]
    doubt_px: float
    """Standard deviation of the area in photo pixels."""
    cut_off: bool
    """Whether it reaches the photo's border."""

    @property
    def part(self) -> "PlacedMask":
        """Where it is, for `filled`."""
        return self.cut, self.mask

    def leaf(self, to_mm: np.ndarray) -> LeafMeasurement:
        """The leaf measured through a homography [3, 3] from photo pixels to mm."""
        outer = apply_homography(to_mm, self.margin)
        found = measure_polygon(outer, tuple(apply_homography(to_mm, hole) for hole in self.holes))
        scale = compute_px_per_mm(to_mm, polygon_centroid(self.margin))
        return LeafMeasurement(
            area_cm2=found.area / 100,
            uncertainty_cm2=self.doubt_px / scale**2 / 100,
            px_per_mm=scale,
            length_mm=found.length,
            width_mm=found.width,
            perimeter_mm=found.perimeter,
            holes_cm2=found.holes / 100,
            **self.drawn(),
        )

    def drawn(self) -> dict:
        """What is known of the leaf without a scale: fields of `Leaf`."""
        return {
            "outline": self.margin - 0.5,
            "holes": tuple(hole - 0.5 for hole in self.holes),
            "note": CUT_OFF if self.cut_off else None,
        }


def looks_like_pen(margin: np.ndarray) -> bool:
    """Whether an outline [n, 2] is a pen's rather than a leaf's: slender, and it fills its box.

    Slender leaves taper: an ellipse fills 0.785 of the box around it.
    """
    points = margin.astype(np.float32)
    _, sides, _ = cv2.minAreaRect(points)
    return min(sides) < _SLENDER * max(sides) and cv2.contourArea(points) > _STRAIGHT * sides[0] * sides[1]


PlacedMask = tuple[Crop, np.ndarray]
"""A leaf as a mask, bool [h, w], in a cut of a photo."""


def coarse_mask(sight: LeafCandidate) -> PlacedMask:
    """A leaf as the network sees it."""
    return sight.cut, sight.placement.to_photo(sight.alone()) >= 0.5


def paint_masks(parts: Iterable[PlacedMask], onto: Crop) -> np.ndarray:
    """bool [H, W], True on the leaves in a cut of the photo."""
    mask = np.zeros(onto.image.shape[:2], bool)
    for cut, leaf in parts:
        height, width = leaf.shape
        ends = onto.of_photo(cut.to_photo(np.array([[0, 0], [width, height]])))
        (left, top), (right, bottom) = np.round(ends).astype(int)
        size = max(1, right - left), max(1, bottom - top)
        region = mask[top : top + size[1], left : left + size[0]]
        # Halfway between leaf and no leaf, so that the margin moves to neither side.
        grown = cv2.resize(leaf.astype(np.uint8) * 255, size, interpolation=cv2.INTER_LINEAR)
        region |= grown[: region.shape[0], : region.shape[1]] >= 128
    return mask


def outline_leaf(sight: LeafCandidate, size: np.ndarray) -> LeafOutline:
    cut, placement = sight.cut, sight.placement
    others = placement.to_photo(sight.neighbours().astype(np.float32)) >= 0.5
    probability = placement.to_photo(sight.alone())
    found = refine_mask(cut.image, probability, 1 / min(placement.scale), others)
    margin, holes = trace_polygons(found.mask)
    # The margin's place, as a whole, and what the colours leave in doubt.
    doubt = np.hypot(_DOUBT * found.doubt_px, _MARGIN_PX * measure_polygon(margin, ()).perimeter)
    margin = cut.to_photo(margin)
    near = (margin <= _BORDER_PX * cut.step).any() or (margin >= size - _BORDER_PX * cut.step).any()
    return LeafOutline(
        cut=cut,
        mask=found.mask,
        margin=np.clip(margin, 0.5, size - 0.5),
        holes=tuple(cut.to_photo(hole) for hole in holes),
        doubt_px=float(doubt * cut.step.prod()),
        cut_off=bool(near),
    )
