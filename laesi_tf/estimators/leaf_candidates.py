"""Candidates for leaves: connected components of a network's mask in a crop of the photo."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, Points
from laesi_tf.common.geometry import ImageSize, from_cv2_contour, pixel_centres
from laesi_tf.data.letterbox import Letterbox
from laesi_tf.estimators.boxes import largest_iou
from laesi_tf.estimators.leaf_colour import LeafColourParams, ThingColour, measure_colour
from laesi_tf.estimators.mask_shapes import grow_mask
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid


@dataclass(frozen=True, kw_only=True)
class LeafDetectorParams:
    """Parameters of the leaf detector."""

    colour: LeafColourParams = field(default_factory=LeafColourParams)
    leaf_probability: float = parameter(0.5, unit="probability")
    """Above it a pixel of a crop is leaf."""
    overview_probability: float = parameter(0.2, unit="probability")
    """The same in the overview and in tiles, where small leaves are faint."""
    crop_side: float = parameter(1.4, unit="longer sides of the box")
    """Side of the crop around a candidate."""
    min_fill: float = parameter(0.5, unit="share of the crop's longer side")
    """A candidate that fills at least this much of its crop is seen as close as leaves are in training."""
    max_fill: float = parameter(0.9, unit="share of the crop's longer side")
    """The same, at most."""
    negligible_fill: float = parameter(0.15, unit="share of the crop's longer side")
    """A component that fills less of a crop is ignored there."""
    first_crop_of_photo: float = parameter(0.1, unit="share of the photo's longer side")
    """Least side of the first crop around a component of the overview, which often shows only a part."""
    first_crop_of_leaf: float = parameter(1.3, unit="typical leaf lengths")
    """Least side of the first crop around a component of a tile."""
    min_contrast: float = parameter(24.0, unit="levels of 255")
    """Least difference between the colours of a leaf and its sheet."""
    confirmation_side: float = parameter(1.75, unit="leaf lengths")
    """Side of the wider crop in which all but the largest leaf must be found again."""
    confirmation_iou: float = parameter(0.6, unit="IoU of boxes")
    """Overlap with which it counts as found again."""
    duplicate_iou: float = parameter(0.7, unit="IoU of boxes")
    """Boxes with more overlap show the same component."""
    duplicate_cover: float = parameter(0.4, unit="share of its pixels")
    """A candidate of which a larger one covers more is the same leaf."""
    merged_cover: float = parameter(
        0.9, unit="share of its pixels", set_on="semi-real photos with pasted leaves, 2026-11-30"
    )
    """A candidate of which smaller ones cover as much may be several leaves."""
    part_area: tuple[float, float] = parameter(
        (0.2, 0.7), unit="share of its area", set_on="semi-real photos with pasted leaves, 2026-11-30"
    )
    """Area of each of them, at least and at most."""
    max_rounds: int = parameter(5, unit="crops of one place")
    """Attempts to zoom in on a component."""
    max_crops: int = parameter(160, unit="crops")
    """Crops in one round; bounds time and memory."""
    min_component_px: float = parameter(6.0, unit="network pixels")
    """Smaller components are noise."""
    tiled_below: float = parameter(0.16, unit="share of the photo's longer side")
    """Leaves shorter than this are searched for in tiles: the network misses some of several small leaves."""
    blank_overview_leaf: float = parameter(0.125, unit="share of the photo's longer side")
    """Leaf length for which a photo is tiled whose overview shows none: in smaller tiles edges and print
    look like leaves."""
    tile_side: float = parameter(2.6, unit="typical leaf lengths")
    tile_stride: float = parameter(1.5, unit="typical leaf lengths")
    min_area_of_largest: float = parameter(
        0.03,
        unit="largest leaf's area",
        set_on="scenes of rendering_2, where all smaller components were ends of petioles, gaps in leaves or "
        "print; the smallest leaf on sheets of seedlings has a sixth; 2026-11-25",
    )
    """Candidates below this area are small fragments."""
    min_area_of_median: float = parameter(
        0.2, unit="median leaf area", set_on="sheets with punch holes and pen strokes, 2026-11-25"
    )
    """The same for candidates from tiles and by contrast, where marks come close to small leaves."""
    max_difference_from_found: float = parameter(
        20.0,
        unit="CIELAB",
        set_on="semi-real photos with pasted leaves, rendered (split develop); 2026-11-30",
    )
    """Largest difference of a further leaf's median colour from that of one that was found."""
    min_crop_px: int = parameter(448, unit="pixels", set_on="twice the network's input, 2026-11-25")
    """Longer side of a crop at least, where the photo has as many pixels."""
    max_crop_px: int = parameter(896, unit="pixels", set_on="what leaf edges need, 2026-11-25")
    """Longer side of a crop at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafCandidate:
    """A connected component that may be a leaf, in a crop of the photo."""

    crop: Crop
    probability: FloatMap
    """float32 [h, w], leaf probability of every pixel of the network's input."""
    letterbox: Letterbox
    """Position of the crop in the network's input."""
    component: Mask
    """bool [h, w], True on the component in the network's input."""
    box: Points
    """[[left, top], [right, bottom]] of the component in photo pixels."""
    is_inside_crop: bool
    """False where the component reaches a side of the crop beyond which the photo continues."""
    params: LeafDetectorParams
    """Parameters of the detector that found it."""
    sightings: int = 1
    """Number of crops that showed it."""

    @property
    def pixel_size(self) -> Points:
        """Width and height (x, y) of a pixel of the network's input in photo pixels."""
        size: Points = self.crop.pixel_size / self.letterbox.scale
        return size

    @property
    def length(self) -> float:
        """Longer side of the box in photo pixels."""
        return float((self.box[1] - self.box[0]).max())

    @property
    def fill_ratio(self) -> float:
        """Longer side of the box over the longer side of the crop."""
        return self.length / float((self.crop.pixel_size * self.crop.size.xy).max())

    @property
    def area(self) -> float:
        """Area of the component in photo pixels."""
        return float(np.count_nonzero(self.component) * self.pixel_size.prod())

    def own_probability(self) -> FloatMap:
        """Return `probability` with all other components set to 0."""
        # One pixel around the component keeps its slope, which interpolation needs.
        near = grow_mask(self.component, 1)
        return np.where(near | (self.probability < self.params.leaf_probability), self.probability, 0)

    def other_leaves_mask(self) -> Mask:
        """Return a mask, bool [h, w], of the other components that are large enough to be leaves."""
        others = (self.probability >= self.params.overview_probability) & ~self.component
        _, labels, statistics, _ = cv2.connectedComponentsWithStats(others.astype(np.uint8))
        least = self.params.min_area_of_largest * np.count_nonzero(self.component)
        is_large = statistics[:, cv2.CC_STAT_AREA] >= least
        is_large[0] = False
        is_large[np.unique(labels[grow_mask(self.component, 1)])] = False
        return is_large[labels]

    def is_cut_off(self, photo: ImageSize) -> bool:
        """Return whether its box reaches a side of the photo."""
        margin = 2 * self.pixel_size
        return bool((self.box[0] <= margin).any() or (self.box[1] >= photo.xy - margin).any())

    def contains(self, points: Points) -> Mask:
        """Return whether photo pixels `points` [N, 2] lie on the component: bool [N]."""
        column, row = np.floor(self.letterbox.to_input_points(self.crop.from_photo(points))).astype(int).T
        height, width = self.component.shape
        is_inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        return is_inside & self.component[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]

    @functools.cached_property
    def colour(self) -> ThingColour:
        """Its colour."""
        inside = self.letterbox.crop_and_resize_back(self.component.astype(np.float32)) >= 0.5
        return measure_colour(self.crop.image, inside, self.params.colour)

    def count_sightings(self, candidates: Sequence["LeafCandidate"]) -> int:
        """Return how many crops showed one of `candidates` with almost the same box."""
        return sum(
            other.sightings
            for other in candidates
            if largest_iou(self.box, other.box[np.newaxis]) > self.params.duplicate_iou
        )

    def pixel_centres(self) -> Points:
        """Return the centres [N, 2] of the component's pixels in photo pixels."""
        return self.crop.to_photo(self.letterbox.to_photo_points(pixel_centres(self.component)))

    def outline(self) -> Points:
        """Return the outer contour [N, 2] of the component in photo pixels."""
        contours, _ = cv2.findContours(
            self.component.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        longest = from_cv2_contour(max(contours, key=len))
        return self.crop.to_photo(self.letterbox.to_photo_points(longest))

    def is_covered_by(self, others: Sequence["LeafCandidate"]) -> bool:
        """Return whether most of the component lies on one of `others`."""
        centres = self.pixel_centres()
        return any(other.contains(centres).mean() > self.params.duplicate_cover for other in others)


def extract_candidates(
    pyramid: PhotoPyramid,
    crop: Crop,
    probability: FloatMap,
    letterbox: Letterbox,
    threshold: float,
    params: LeafDetectorParams,
) -> list[LeafCandidate]:
    """Return the connected components of `probability` [h, w] above a threshold in one crop."""
    above = (probability >= threshold).astype(np.uint8)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(above)
    candidates = []
    for label in range(1, count):
        if statistics[label, cv2.CC_STAT_AREA] < params.min_component_px:
            continue
        corners, is_inside = _locate(pyramid, crop, letterbox, statistics[label])
        # Components that lie wholly in the padding of the letterbox have an empty box.
        if (corners[1] > corners[0]).all():
            candidates.append(
                LeafCandidate(
                    crop=crop,
                    probability=probability,
                    letterbox=letterbox,
                    component=labels == label,
                    box=corners,
                    is_inside_crop=is_inside,
                    params=params,
                )
            )
    return candidates


def _locate(
    pyramid: PhotoPyramid, crop: Crop, letterbox: Letterbox, statistics: NDArray[np.int32]
) -> tuple[Points, bool]:
    """Return a component's box [2, 2] in photo pixels and whether it lies inside the crop."""
    left, top, width, height = statistics[:4]
    end = crop.size.xy
    corners = letterbox.to_photo_points(np.array([[left, top], [left + width, top + height]]))
    corners = np.clip(corners, 0, end)
    pixel = 1 / letterbox.scale
    touches = np.stack([corners[0] <= 1.01 * pixel, corners[1] >= end - 1.01 * pixel])
    continues = np.stack([crop.origin > 0.5, crop.to_photo(end) < pyramid.size.xy - 0.5])
    return crop.to_photo(corners), not (touches & continues).any()
