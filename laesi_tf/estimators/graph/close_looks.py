"""Find the leaves on a photo inside a graph: overviews, then closer and closer crops of what may be a leaf.

The rules and their thresholds are those of `estimators.leaf_detector`; a queue of boxes in one loop replaces
its rounds, so that the mask network stands once in the graph and runs as often as the photo needs.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.estimators.graph.components import MOST, Components, find_components, grow_mask
from laesi_tf.estimators.graph.crops import Square, cut_square, fit_square
from laesi_tf.estimators.graph.gloss import fill_gloss
from laesi_tf.estimators.leaf_candidates import LeafDetectorParams
from laesi_tf.estimators.mask_refinement import MaskRefinementParams
from laesi_tf.estimators.parameters import parameter

MaskNetwork = Callable[[tf.Tensor], tf.Tensor]
"""float32 [B, s, s, 3] of 0..255 -> leaf probability, float32 [B, s, s, 1]."""

MAX_LEAVES = 16
_QUEUE = 48
_BOX, _ROUND = slice(0, 4), 4
"""Columns of the queue: the box to look at, and how often its place was looked at before."""


@dataclass(frozen=True, kw_only=True)
class CloseLookParams:
    """Parameters of the looks."""

    detector: LeafDetectorParams = field(default_factory=LeafDetectorParams)
    refinement: MaskRefinementParams = field(default_factory=MaskRefinementParams)
    ruled_share: float = parameter(0.8, unit="share of the photo's longer side", set_on="by hand, 2026-11-29")
    """A ruled sheet that is smaller is searched in a crop of its own."""
    max_looks: int = parameter(40, unit="crops", set_on="time on a phone")
    """Crops of one photo, overviews included."""
    haze_px: int = parameter(4, unit="network pixels", set_on="edges are about as wide")
    """Probability this near to a leaf belongs to it."""


class Found(NamedTuple):
    """Leaves, the last ones found first; [MAX_LEAVES, ...] each."""

    area: tf.Tensor
    """[L], frame pixels; 0 where there is none."""
    square: tf.Tensor
    """[L, 3], left, top and side of the crop, frame pixels."""
    box: tf.Tensor
    """[L, 4], of the leaf, frame pixels."""
    leaf: tf.Tensor
    """[L, s, s], probability of leaf in the crop, 0 away from this leaf."""


def measure_overlap(boxes: tf.Tensor, others: tf.Tensor) -> tf.Tensor:
    """Return the intersection over union [N, M] of `boxes` [N, 4] with `others` [M, 4]."""
    one, other = boxes[:, None], others[None]
    shared = tf.minimum(one[..., 2:], other[..., 2:]) - tf.maximum(one[..., :2], other[..., :2])
    shared = tf.reduce_prod(tf.maximum(shared, 0.0), -1)
    areas = [tf.reduce_prod(box[..., 2:] - box[..., :2], -1) for box in (one, other)]
    return shared / tf.maximum(areas[0] + areas[1] - shared, 1e-6)


def widen_box(box: tf.Tensor, side: tf.Tensor) -> tf.Tensor:
    """Return squares [..., 4] of `side` [...] with the centres of `box` [..., 4]."""
    middle = (box[..., :2] + box[..., 2:]) / 2
    half = side[..., None] / 2
    return tf.concat([middle - half, middle + half], -1)


def find_leaves(
    levels: list[tf.Tensor],
    size: tf.Tensor,
    boxes: tf.Tensor,
    count: tf.Tensor,
    network: MaskNetwork,
    *,
    side: int,
    params: CloseLookParams,
    before: Found | None = None,
) -> Found:
    """Return the leaves on a photo of `size` [2], (height, width), in the upper left corner of a frame.

    `levels` are those of `make_levels` for crops of `side` pixels, which `network` takes. The first `count`
    of `boxes` [N, 4] are overviews in which to search, in the second where the first shows nothing; with
    leaves found `before`, they are those of what may be further ones.
    """
    detector = params.detector
    first_side = detector.first_crop_of_photo * tf.reduce_max(size)
    exist = tf.cast(tf.range(boxes.shape[0]) < count, tf.float32)[:, None]
    first_round = 0.0 if before is None else 1.0
    queue = tf.concat([boxes * exist, first_round * exist], 1)
    queue = tf.pad(queue, [[0, _QUEUE - boxes.shape[0]], [0, 0]])
    if before is None:
        # Not a constant, which would be stored with all its zeros.
        zero = tf.cast(size[0] < 0, tf.float32)
        before = Found(*(tf.fill([MAX_LEAVES, *shape], zero) for shape in ([], [3], [4], [side, side])))

    def is_waiting(turn: tf.Tensor, tail: tf.Tensor, *_: tf.Tensor) -> tf.Tensor:
        return (turn < tail) & (turn < params.max_looks)

    def look(turn: tf.Tensor, tail: tf.Tensor, queue: tf.Tensor, *found: tf.Tensor) -> tuple[tf.Tensor, ...]:
        row = tf.gather(queue, turn)
        is_overview = row[_ROUND] < 0.5
        is_first = row[_ROUND] < 1.5
        box = row[_BOX]
        wide = tf.maximum(
            detector.crop_side * tf.reduce_max(box[2:] - box[:2]), tf.where(is_first, first_side, 0.0)
        )
        square = fit_square(tf.where(is_overview, box, widen_box(box, wide)), size)
        image = cut_square(levels, square, side)
        probability = network(image[None])[0, ..., 0]
        threshold = tf.where(is_overview, detector.overview_probability, detector.leaf_probability)
        mask = tf.cast(probability >= threshold, tf.float32)
        components = find_components(mask)
        places, is_inside, exists = _locate(components, square, size, side, detector)
        length = tf.reduce_max(places[:, 2:] - places[:, :2], 1)
        fill = length / square.side
        is_tried = (tf.range(_QUEUE) < tail) & (queue[:, _ROUND] > 0.5)
        overlap = tf.where(is_tried, measure_overlap(places, queue[:, _BOX]), 0.0)
        was_tried = tf.reduce_max(overlap, 1) > detector.duplicate_iou
        is_close = (fill >= detector.min_fill) & (fill <= detector.max_fill)
        is_large = exists & ~is_overview & (fill >= detector.negligible_fill)
        accepts = is_large & is_inside & (was_tried | is_close)
        following = tf.where(is_inside[:, None], places, widen_box(places, detector.crop_side * length))
        following = tf.where(is_overview, places, following)
        # The second overview is for what the first one misses altogether.
        searches = exists & ((turn < 1) | tf.equal(tail, count))
        goes_on = tf.where(is_overview, searches, is_large & ~accepts)
        goes_on &= row[_ROUND] < detector.max_rounds
        queue, tail = _append(queue, tail, following, goes_on, row[_ROUND] + 1, detector)

        def keep() -> Found:
            def keep_next(left: tf.Tensor, *kept: tf.Tensor) -> tuple[tf.Tensor, ...]:
                leaf, index, left = _take_first(left, components, mask, probability, params)
                leaf = fill_gloss(leaf, image, params.refinement)
                return left, *_add(Found(*kept), leaf, tf.gather(places, index), square)

            start = (accepts, *found)
            return Found(*tf.while_loop(lambda left, *_: tf.reduce_any(left), keep_next, start)[1:])

        kept = tf.cond(tf.reduce_any(accepts), keep, lambda: Found(*found))
        return turn + 1, tail, queue, *kept

    start = (tf.constant(0), count, queue, *before)
    return Found(*tf.while_loop(is_waiting, look, start, maximum_iterations=params.max_looks)[3:])


def confirm_leaves(
    levels: list[tf.Tensor],
    size: tf.Tensor,
    found: Found,
    count: tf.Tensor,
    network: MaskNetwork,
    *,
    side: int,
    params: LeafDetectorParams,
) -> tf.Tensor:
    """Return which of the first `count` leaves look the same in a wider crop, as print and marks do not.

    bool [MAX_LEAVES]; the first leaf is not asked.
    """

    def confirm(turn: tf.Tensor, flags: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        box = tf.gather(found.box, turn)
        wide = widen_box(box, params.confirmation_side * tf.reduce_max(box[2:] - box[:2]))
        square = fit_square(wide, size)
        probability = network(cut_square(levels, square, side)[None])[0, ..., 0]
        components = find_components(tf.cast(probability >= params.leaf_probability, tf.float32))
        boxes, _, exists = _locate(components, square, size, side, params)
        overlap = tf.reduce_max(tf.where(exists, measure_overlap(box[None], boxes)[0], 0.0))
        is_seen = tf.cast(overlap > params.confirmation_iou, tf.float32)
        return turn + 1, flags + tf.one_hot(turn, MAX_LEAVES) * is_seen

    start = (tf.constant(1), tf.one_hot(0, MAX_LEAVES))
    _, flags = tf.while_loop(lambda turn, _: turn < count, confirm, start, maximum_iterations=MAX_LEAVES - 1)
    return flags > 0


def _locate(
    components: Components, square: Square, size: tf.Tensor, side: int, detector: LeafDetectorParams
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Return the boxes [MOST, 4] of components in frame pixels, whether each lies inside its crop where the
    photo continues beyond it, and whether there is one at all."""
    pixel = square.side / side
    corner = tf.stack([square.left, square.top])
    low = tf.maximum(corner + components.boxes[:, :2] * pixel, square.shown[:2])
    high = tf.minimum(corner + components.boxes[:, 2:] * pixel, square.shown[2:])
    # Boxes are of two pixels of the network.
    touches_low = (low <= square.shown[:2] + 2.01 * pixel) & (square.shown[:2] > 0.5)
    ends = tf.reverse(size, [0])
    touches_high = (high >= square.shown[2:] - 2.01 * pixel) & (square.shown[2:] < ends - 0.5)
    is_inside = ~tf.reduce_any(touches_low | touches_high, 1)
    exists = (components.count >= detector.min_component_px) & tf.reduce_all(high > low, 1)
    return tf.concat([low, high], 1), is_inside, exists


def _append(
    queue: tf.Tensor,
    tail: tf.Tensor,
    boxes: tf.Tensor,
    wanted: tf.Tensor,
    turn: tf.Tensor,
    detector: LeafDetectorParams,
) -> tuple[tf.Tensor, tf.Tensor]:
    """Add the `wanted` of `boxes` [MOST, 4] to the queue, but for those that were looked at before."""
    is_tried = (tf.range(_QUEUE) < tail) & (queue[:, _ROUND] > 0.5)
    before = tf.where(is_tried, measure_overlap(boxes, queue[:, _BOX]), 0.0)
    order = tf.range(MOST)
    earlier = (order[None] < order[:, None]) & wanted
    among = tf.where(earlier, measure_overlap(boxes, boxes), 0.0)
    most = tf.maximum(tf.reduce_max(before, 1), tf.reduce_max(among, 1))
    flags = tf.cast(wanted & (most <= detector.duplicate_iou), tf.int32)
    places = tail + tf.cumsum(flags) - 1
    added = tf.cast(tf.equal(tf.range(_QUEUE)[:, None], places), tf.float32) * tf.cast(flags, tf.float32)
    rows = tf.concat([boxes, tf.fill([MOST, 1], turn)], 1)
    return queue + tf.matmul(added, rows), tf.minimum(tail + tf.reduce_sum(flags), _QUEUE)


def _take_first(
    accepts: tf.Tensor,
    components: Components,
    mask: tf.Tensor,
    probability: tf.Tensor,
    params: CloseLookParams,
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Return the probability [s, s] of the first component that `accepts` [MOST], its index, and which are
    left."""
    index = tf.argmax(tf.cast(accepts, tf.int32), output_type=tf.int32)
    own = components.select(index, mask)
    leaf = tf.where(
        (grow_mask(own, 1) > 0) | (probability < params.detector.leaf_probability), probability, 0.0
    )
    left = accepts & (tf.range(MOST) != index)
    return leaf * grow_mask(own, params.haze_px), index, left


def _add(found: Found, leaf: tf.Tensor, box: tf.Tensor, square: Square) -> Found:
    """Return `found` with a `leaf` [s, s] in `square`."""
    pixel = square.side / leaf.shape[0]
    new = Found(
        area=tf.reduce_sum(tf.cast(leaf >= 0.5, tf.float32)) * pixel**2,
        square=tf.stack([square.left, square.top, square.side]),
        box=box,
        leaf=leaf,
    )
    return Found(*(tf.concat([value[None], old[:-1]], 0) for value, old in zip(new, found, strict=True)))
