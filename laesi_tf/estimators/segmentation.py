"""Area as each leaf's silhouette times a scale that is given: a network finds the silhouettes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import keras
import numpy as np

from laesi_tf.estimators.base import NOTHING, Known, Leaf, Measurement, in_reading_order
from laesi_tf.estimators.finding import Sight, find
from laesi_tf.estimators.margin import silhouette
from laesi_tf.estimators.network import compiled
from laesi_tf.estimators.shape import centroid, mapped, polygons, px_per_mm, shape
from laesi_tf.estimators.views import Cut, Views

METHOD = "mask x given scale"
NO_LEAF = "no leaf found; show one whole leaf on the paper"
CUT_OFF = "cut off by the photo's border: at least this much"
_BORDER_PX = 1.5
"""A leaf that comes this close to the photo's border is taken to go on beyond it."""
_LEAST_PX = 50.0
"""Photo pixels of which nothing can be told."""
_SLENDER, _STRAIGHT = 0.2, 0.8
"""Width over length of a rod at most, and the share of its box that it fills at least."""
_DOUBT, _MARGIN_PX = 0.8, 0.16
"""Standard deviations of a silhouette's area, in doubtful pixels and in pixels of its margin: two thirds of
semi-real photographs, whose leaves lie flat, are within what they and `reading._SCALE_FLOOR` give."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A leaf's silhouette in photo pixels, their centres at halves."""

    cut: Cut
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
    def part(self) -> "Part":
        """Where it is, for `filled`."""
        return self.cut, self.mask

    def leaf(self, to_mm: np.ndarray) -> Leaf:
        """The leaf measured through a homography [3, 3] from photo pixels to mm."""
        outer = mapped(to_mm, self.margin)
        found = shape(outer, tuple(mapped(to_mm, hole) for hole in self.holes))
        scale = px_per_mm(to_mm, centroid(self.margin))
        return Leaf(
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


class Segmentation:
    """The mask network of a run; it finds no scale itself and refuses the areas when none is given."""

    def __init__(self, model: keras.Model, size: tuple[int, int]) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> leaf probability [B, h, w, 1]; `size` is (h, w)."""
        self._size = size
        self._predict = compiled(model, size)

    def measure(self, image: np.ndarray, known: Known = NOTHING) -> Measurement:
        """As `Estimator.measure`; mask and outlines are given even where the areas are refused."""
        views = Views(image)
        outlines = self.outlines(views)
        mask = filled((outline.part for outline in outlines), views.photo)
        if not outlines:
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        if known.px_per_mm is None:
            leaves = tuple(Leaf(**outline.drawn()) for outline in outlines)
            refusal = "the scale is not known; give px_per_mm or use an area model"
            return Measurement(method=METHOD, leaves=leaves, mask=mask, refusal=refusal)
        to_mm = np.diag([1.0, 1.0, known.px_per_mm])
        leaves = tuple(outline.leaf(to_mm) for outline in outlines)
        return Measurement(method=METHOD, leaves=leaves, mask=mask)

    def outlines(self, views: Views) -> list[Outline]:
        """The leaves on a photo in reading order."""
        return self.outlined(self.sights(views), views)

    def sights(self, views: Views) -> list[Sight]:
        """The leaves on a photo as the network sees them, coarsely."""
        return find(views, self._predict, self._size)

    def outlined(self, sights: Sequence[Sight], views: Views) -> list[Outline]:
        """The leaves that were seen, at the photo's own resolution, in reading order."""
        found = [_outline(sight, views.size) for sight in sights]
        outlines = [outline for outline in found if shape(outline.margin, outline.holes).area >= _LEAST_PX]
        if len(outlines) > 1:
            outlines = [outline for outline in outlines if not is_rod(outline.margin)] or outlines
        boxes = np.array([[one.margin.min(axis=0), one.margin.max(axis=0)] for one in outlines])
        return [outlines[index] for index in in_reading_order(boxes.reshape(-1, 2, 2))]


def is_rod(margin: np.ndarray) -> bool:
    """Whether an outline [n, 2] is a pen's rather than a leaf's: slender, and it fills its box.

    Slender leaves taper: an ellipse fills 0.785 of the box around it.
    """
    points = margin.astype(np.float32)
    _, sides, _ = cv2.minAreaRect(points)
    return min(sides) < _SLENDER * max(sides) and cv2.contourArea(points) > _STRAIGHT * sides[0] * sides[1]


Part = tuple[Cut, np.ndarray]
"""A leaf as a mask, bool [h, w], in a cut of a photo."""


def coarse(sight: Sight) -> Part:
    """A leaf as the network sees it."""
    return sight.cut, sight.placement.to_photo(sight.alone()) >= 0.5


def filled(parts: Iterable[Part], onto: Cut) -> np.ndarray:
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


def _outline(sight: Sight, size: np.ndarray) -> Outline:
    cut, placement = sight.cut, sight.placement
    others = placement.to_photo(sight.neighbours().astype(np.float32)) >= 0.5
    probability = placement.to_photo(sight.alone())
    found = silhouette(cut.image, probability, 1 / min(placement.scale), others)
    margin, holes = polygons(found.mask)
    # The margin's place, as a whole, and what the colours leave in doubt.
    doubt = np.hypot(_DOUBT * found.doubt_px, _MARGIN_PX * shape(margin, ()).perimeter)
    margin = cut.to_photo(margin)
    near = (margin <= _BORDER_PX * cut.step).any() or (margin >= size - _BORDER_PX * cut.step).any()
    return Outline(
        cut=cut,
        mask=found.mask,
        margin=np.clip(margin, 0.5, size - 0.5),
        holes=tuple(cut.to_photo(hole) for hole in holes),
        doubt_px=float(doubt * cut.step.prod()),
        cut_off=bool(near),
    )
