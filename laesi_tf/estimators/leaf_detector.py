"""Find the leaves on a photo: a glance at the whole sheet, then a close look at whatever may be a leaf.

The mask network was trained on pictures that a leaf fills to a third or more. In a photo of a whole sheet
small leaves are smears that run into each other, but most are seen; so the look is repeated around each,
closer and closer, until it fills its view as leaves do in training. Where the leaves turn out to be small,
the sheet is gone over once more in tiles, for those that the glance missed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.data.letterbox import Letterbox, letterbox_image
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid

MaskPredictor = Callable[[np.ndarray], np.ndarray]
"""A mask network: uint8 [N, h, w, 3] -> leaf probability, float32 [N, h, w, 1]."""

_SEEN, _GLIMPSED = 0.5, 0.2
"""Probability above which a pixel is leaf in a close view; and in a glance, where small leaves are faint."""
_ROOM = 1.4
"""Side of a close view in units of the longer side of what it shows."""
_FILLS = 0.5, 0.9
"""A piece whose longer side takes up this share of its view is seen as closely as leaves are in training."""
_SLIGHT = 0.15
"""A piece that fills less of a close view is no business of that view."""
_NARROWEST, _AROUND = 0.1, 1.3
"""First views span at least this share of the photo after a glance, and so many leaves after tiles."""
_COLOURED = 24
"""Levels by which a leaf differs from its sheet at least."""
_FURTHER, _SAME = 1.75, 0.6
"""Side of the view that confirms a leaf in units of its length, and the overlap of both boxes that does."""
_ALIKE = 0.7
"""Boxes whose intersection over union exceeds this show the same."""
_ROUNDS, _MOST = 5, 160
"""Looks at one place, and places looked at in one round."""
_SPECK = 6
"""Pieces of fewer pixels of the network are nothing."""
_SMALL, _TILE, _STRIDE = 0.16, 2.6, 1.5
"""Leaves of less than this share of the photo are sought in tiles as wide as so many leaves, so far apart: of
several small leaves in one view the network overlooks some."""
_LEAST = 0.03
"""Share of the largest leaf's area below which a piece is a crumb: on fresh scenes all such pieces were ends
of petioles, gaps in leaves or print, while on sheets of seedlings the smallest leaf has a sixth of the
largest."""
_STRICTER = 0.2
"""The same in tiles, against the leaves' median: punch holes and pen strokes come close to small leaves
there."""
_COARSEST_PX, _SHARPEST_PX = 448, 896
"""Longer side of a view: at least twice the network's where the photo has it, at most what margins need."""


@dataclass(frozen=True, eq=False)
class LeafCandidate:
    """A piece that may be a leaf, in a view of it; `probability` [h, w] covers the network's input."""

    cut: Crop
    probability: np.ndarray
    placement: Letterbox
    piece: np.ndarray
    """bool [h, w], True on the piece, in the network's input."""
    box: np.ndarray
    """[[left, top], [right, bottom]] of the piece in photo pixels."""
    within: bool
    """Whether it ends within the view, wherever the photo goes on beyond it."""

    @property
    def longest(self) -> float:
        """Longer side of the box in photo pixels."""
        return float((self.box[1] - self.box[0]).max())

    @property
    def fill(self) -> float:
        """Longer side of the piece over that of its view."""
        return self.longest / float((self.cut.step * self.cut.image.shape[1::-1]).max())

    @property
    def area(self) -> float:
        """Area of the piece in photo pixels."""
        return float(np.count_nonzero(self.piece) * (self.cut.step / self.placement.scale[::-1]).prod())

    def alone(self) -> np.ndarray:
        """`probability` of this piece, 0 on all others."""
        # A pixel of slope is left around the piece, for the upsampling.
        near = cv2.dilate(self.piece.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        return np.where(near | (self.probability < _SEEN), self.probability, 0)

    def neighbours(self) -> np.ndarray:
        """Other pieces in view, bool [h, w], that are large enough to be leaves or reach out of it."""
        _, labels, statistics, _ = cv2.connectedComponentsWithStats(
            ((self.probability >= _GLIMPSED) & ~self.piece).astype(np.uint8)
        )
        large = statistics[:, cv2.CC_STAT_AREA] >= _LEAST * np.count_nonzero(self.piece)
        large[0] = False
        touching = cv2.dilate(self.piece.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        large[np.unique(labels[touching])] = False
        return large[labels]

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Whether the piece holds photo pixels `points` [N, 2], bool [N]."""
        inner = self.cut.of_photo(points) * self.placement.scale[::-1] + self.placement.offset[::-1]
        column, row = np.floor(inner).astype(int).T
        height, width = self.piece.shape
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        return inside & self.piece[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]

    def points(self) -> np.ndarray:
        """Photo pixels [N, 2] at the middles of the piece's pixels."""
        inner = np.argwhere(self.piece)[:, ::-1] + 0.5 - self.placement.offset[::-1]
        return self.cut.to_photo(inner / self.placement.scale[::-1])


def find_leaves(views: PhotoPyramid, predict: MaskPredictor, size: tuple[int, int]) -> list[LeafCandidate]:
    """The leaves on a photo, largest first, as a mask network of input `size` (h, w) sees them."""
    small, placement = views.fitted(size)
    glance = predict(small[np.newaxis])[0, ..., 0]
    boxes = [sight.box for sight in _extract_candidates(views, views.whole, glance, placement, _GLIMPSED)]
    found = _remove_duplicates(_zoom_in(views, predict, size, boxes, _NARROWEST * views.size.max()))
    if found:
        typical = float(np.median([sight.longest for sight in found]))
        found = _add_leaves_by_colour(views, predict, size, found)
        if typical < _SMALL * views.size.max():
            found = _add_leaves_from_tiles(views, predict, size, found, typical)
    else:
        # Too small for a glance. Smaller tiles than these would show edges and print as leaves.
        found = _add_leaves_from_tiles(views, predict, size, found, views.size.max() / 8)
        found = _add_leaves_by_colour(views, predict, size, found)
    return found[:1] + _confirm_at_lower_zoom(views, predict, size, found[1:])


def _add_leaves_by_colour(
    views: PhotoPyramid, predict: MaskPredictor, size: tuple[int, int], found: list[LeafCandidate]
) -> list[LeafCandidate]:
    """`found` and, where they are several, as the network overlooks some in one view, what colour shows."""
    if len(found) < 2:
        return found
    small, placement = views.fitted(size)
    coloured = _segment_by_colour(small, placement)
    boxes = [sight.box for sight in _extract_candidates(views, views.whole, coloured, placement, _SEEN)]
    more = _zoom_in(views, predict, size, boxes, 0.0)
    return _remove_duplicates(found + _drop_small(more, found))


def _add_leaves_from_tiles(
    views: PhotoPyramid,
    predict: MaskPredictor,
    size: tuple[int, int],
    found: list[LeafCandidate],
    typical: float,
) -> list[LeafCandidate]:
    """`found` and what tiles for leaves `typical` photo pixels long show besides."""
    tiles = list(_tile_photo(views.size, typical))
    glimpsed = [sight for sight in _segment_crops(views, predict, size, tiles, _GLIMPSED) if sight.within]
    boxes = [sight.box for sight in glimpsed if not _is_covered_by(sight, found)]
    more = _zoom_in(views, predict, size, boxes, _AROUND * typical)
    return _remove_duplicates(found + _drop_small(more, found))


def _segment_by_colour(small: np.ndarray, placement: Letterbox) -> np.ndarray:
    """1 where `small`, uint8 [h, w, 3], differs in colour from the sheet, else 0: float32 [h, w]."""
    side = min(255, min(placement.extent) // 3 | 1)
    off = cv2.absdiff(small, cv2.medianBlur(small, side)).astype(np.float32).max(axis=2)
    threshold, _ = cv2.threshold(off.astype(np.uint8), 0, 255, cv2.THRESH_OTSU)
    marked = (off > max(threshold, _COLOURED)).astype(np.uint8)
    return cv2.morphologyEx(marked, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(np.float32)


def _drop_small(sights: Sequence[LeafCandidate], found: Sequence[LeafCandidate]) -> list[LeafCandidate]:
    """Those of `sights` that are not much smaller than the leaves found before."""
    areas = [sight.area for sight in found or sights]
    return [sight for sight in sights if sight.area >= _STRICTER * float(np.median(areas))]


def _confirm_at_lower_zoom(
    views: PhotoPyramid, predict: MaskPredictor, size: tuple[int, int], sights: Sequence[LeafCandidate]
) -> list[LeafCandidate]:
    """Those of `sights` that look alike from further away, as print and specks do not."""
    boxes = [_square_around(sight.box, _FURTHER * sight.longest) for sight in sights]
    again = _segment_crops(views, predict, size, boxes, _SEEN)
    return [sight for sight in sights if any(_box_iou(sight.box, one.box) > _SAME for one in again)]


def _tile_photo(size: np.ndarray, leaf: float) -> Iterator[np.ndarray]:
    """Overlapping squares over a photo of `size` (width, height) with leaves `leaf` pixels long."""
    side = min(_TILE * leaf, float(size.min()))
    steps = [max(1, int(np.ceil((length - side) / (_STRIDE * leaf))) + 1) for length in size]
    for top in np.linspace(0, size[1] - side, steps[1]):
        for left in np.linspace(0, size[0] - side, steps[0]):
            yield np.array([[left, top], [left + side, top + side]])


def _zoom_in(
    views: PhotoPyramid,
    predict: MaskPredictor,
    size: tuple[int, int],
    boxes: Sequence[np.ndarray],
    narrowest: float,
) -> list[LeafCandidate]:
    """Look at what is in `boxes` closer and closer until each piece fills its view.

    First views have `narrowest` photo pixels or more: of a small leaf a glance often shows but a part.
    """
    found: list[LeafCandidate] = []
    tried: list[np.ndarray] = []
    waiting = _drop_similar_boxes(boxes, tried)
    for _ in range(_ROUNDS):
        tried += waiting
        following = []
        squares = [_square_around(box, narrowest) for box in waiting]
        narrowest = 0.0
        for sight in _segment_crops(views, predict, size, squares, _SEEN):
            if sight.fill < _SLIGHT:
                continue
            settled = any(_box_iou(sight.box, box) > _ALIKE for box in tried)
            if not sight.within:
                following.append(_square_around(sight.box, 0.0))
            elif settled or _FILLS[0] <= sight.fill <= _FILLS[1]:
                found.append(sight)
            else:
                following.append(sight.box)
        waiting = _drop_similar_boxes(following, tried)
    return found


def _segment_crops(
    views: PhotoPyramid,
    predict: MaskPredictor,
    size: tuple[int, int],
    boxes: Sequence[np.ndarray],
    threshold: float,
) -> list[LeafCandidate]:
    """The pieces above a threshold in a view of each box."""
    parts = (boxes[first : first + _MOST] for first in range(0, len(boxes), _MOST))
    return [sight for part in parts for sight in _segment_batch(views, predict, size, part, threshold)]


def _segment_batch(
    views: PhotoPyramid,
    predict: MaskPredictor,
    size: tuple[int, int],
    boxes: Sequence[np.ndarray],
    threshold: float,
) -> list[LeafCandidate]:
    cuts = [views.around(box, at_least=_COARSEST_PX, at_most=_SHARPEST_PX) for box in boxes]
    fitted = [letterbox_image(cut.image, size) for cut in cuts]
    seen = predict(np.stack([small for small, _ in fitted]))[..., 0]
    looks = zip(cuts, seen, fitted, strict=True)
    return [
        sight
        for cut, probability, (_, placement) in looks
        for sight in _extract_candidates(views, cut, probability, placement, threshold)
    ]


def _extract_candidates(
    views: PhotoPyramid, cut: Crop, probability: np.ndarray, placement: Letterbox, threshold: float
) -> list[LeafCandidate]:
    """The connected pieces above a threshold in one view."""
    above = (probability >= threshold).astype(np.uint8)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(above)
    large = np.flatnonzero(statistics[:, cv2.CC_STAT_AREA] >= _SPECK)
    found = [
        _make_candidate(views, cut, probability, placement, labels == label) for label in large if label > 0
    ]
    # In the filling around a photo of another shape there is nothing.
    return [sight for sight in found if (sight.box[1] > sight.box[0]).all()]


def _make_candidate(
    views: PhotoPyramid, cut: Crop, probability: np.ndarray, placement: Letterbox, piece: np.ndarray
) -> LeafCandidate:
    left, top, width, height = cv2.boundingRect(piece.astype(np.uint8))
    corners = np.array([[left, top], [left + width, top + height]]) - placement.offset[::-1]
    end = np.array(cut.image.shape[1::-1])
    pixel = 1 / np.array(placement.scale[::-1])
    corners = np.clip(corners * pixel, 0, end)
    touching = np.stack([corners[0] <= 1.01 * pixel, corners[1] >= end - 1.01 * pixel])
    beyond = np.stack([cut.origin > 0.5, cut.to_photo(end) < views.size - 0.5])
    return LeafCandidate(
        cut, probability, placement, piece, cut.to_photo(corners), not (touching & beyond).any()
    )


def _remove_duplicates(sights: Sequence[LeafCandidate]) -> list[LeafCandidate]:
    """`sights`, the largest first, without those that are part of another and without crumbs."""
    kept: list[LeafCandidate] = []
    for sight in sorted(sights, key=lambda sight: -sight.area):
        if (not kept or sight.area >= _LEAST * kept[0].area) and not _is_covered_by(sight, kept):
            kept.append(sight)
    return kept


def _is_covered_by(sight: LeafCandidate, kept: Sequence[LeafCandidate]) -> bool:
    """Whether a piece is for the most part one of `kept`."""
    points = sight.points()
    return any(other.holds(points).mean() > 0.4 for other in kept)


def _drop_similar_boxes(boxes: Sequence[np.ndarray], tried: Sequence[np.ndarray]) -> list[np.ndarray]:
    """`boxes` that show neither the same as another of them nor as one of `tried`."""
    kept: list[np.ndarray] = []
    for box in boxes:
        if all(_box_iou(box, other) <= _ALIKE for other in [*tried, *kept]):
            kept.append(box)
    return kept[:_MOST]


def _square_around(box: np.ndarray, narrowest: float) -> np.ndarray:
    """The close view of what is in `box`, `narrowest` photo pixels wide or more."""
    middle, side = box.mean(axis=0), max(narrowest, _ROOM * float((box[1] - box[0]).max()))
    return np.stack([middle - side / 2, middle + side / 2])


def _box_iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two boxes."""
    shared = np.clip(np.minimum(one[1], other[1]) - np.maximum(one[0], other[0]), 0, None).prod()
    return float(shared / ((one[1] - one[0]).prod() + (other[1] - other[0]).prod() - shared))
