"""Find and choose the leaves of a photo inside a graph, and count what may be further ones."""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.estimators.graph.close_looks import (
    MAX_LEAVES,
    CloseLookParams,
    Found,
    MaskNetwork,
    confirm_leaves,
    find_leaves,
)
from laesi_tf.estimators.graph.components import MOST
from laesi_tf.estimators.graph.edge_refinement import Refined
from laesi_tf.estimators.graph.leaf_measures import choose_distinct, measure_share_on
from laesi_tf.estimators.graph.leaf_shapes import choose_leaves, judge_shapes
from laesi_tf.estimators.graph.overview_colours import (
    Overview,
    Things,
    find_things,
    measure_colours,
    measure_near,
    paint_leaves,
)
from laesi_tf.estimators.leaf_outline import LeafOutlineParams


class Search(NamedTuple):
    """What was found on a photo."""

    found: Found
    counts: tf.Tensor
    """bool [MAX_LEAVES], which of it are leaves."""
    things: Things
    """What has a leaf's colour."""


def put_first(found: Found, counts: tf.Tensor) -> tuple[Found, tf.Tensor]:
    """Return the leaves that `counts` [L] before the others, by falling area, and which they are."""
    (found, *_), counts = take_first(Refined(found, found.area, counts), counts)
    return found, counts


def take_first(refined: Refined, counts: tf.Tensor) -> tuple[Refined, tf.Tensor]:
    """Return the `refined` leaves in the same order as `put_first`."""
    scores, order = tf.math.top_k(tf.where(counts, refined.found.area, 0.0), MAX_LEAVES)
    return tf.nest.map_structure(lambda part: tf.gather(part, order), refined), scores > 0


def reaches_border(boxes: tf.Tensor, size: tf.Tensor, margin: tf.Tensor) -> tf.Tensor:
    """Return whether each of `boxes` [N, 4] comes within a `margin` of the border of a photo of `size`."""
    return tf.reduce_any((boxes[:, :2] <= margin) | (boxes[:, 2:] >= tf.reverse(size, [0]) - margin), 1)


def search_leaves(
    levels: list[tf.Tensor],
    size: tf.Tensor,
    boxes: tf.Tensor,
    count: tf.Tensor,
    network: MaskNetwork,
    overview: Overview,
    *,
    params: CloseLookParams,
    outline: LeafOutlineParams,
) -> Search:
    """Return what the overviews `boxes`, see `find_leaves`, and the colours of the `overview` show."""
    side, detector = overview.image.shape[0], params.detector
    found = find_leaves(levels, size, boxes, count, network, side=side, params=params)
    found, counts = put_first(*choose_distinct(found, detector))
    number = tf.reduce_sum(tf.cast(counts, tf.int32))
    counts &= confirm_leaves(levels, size, found, number, network, side=side, params=detector)
    found, counts = put_first(found, counts)
    painted = paint_leaves(overview, found, counts)
    things = find_things(overview, painted, detector.colour)
    margin = 2 * overview.square.side / side
    whole = counts & ~reaches_border(found.box, size, margin)
    colours = measure_colours(painted, things.lab)

    def look_alike(others: tf.Tensor) -> tf.Tensor:
        """Return whether colours [N, 3] are alike those of a whole leaf that was found."""
        apart = tf.sqrt(tf.reduce_sum((others[:, None] - colours) ** 2, -1))
        return tf.reduce_min(tf.where(whole, apart, 1e9), 1) < detector.max_difference_from_found

    candidates = things.found
    is_further = (candidates.area > 0) & (things.near_found < detector.colour.found_share)
    is_further &= look_alike(things.colours) & ~reaches_border(candidates.box, size, margin)

    def look_again() -> tuple[tf.Tensor, ...]:
        scores, order = tf.math.top_k(tf.where(is_further, candidates.area, 0.0), MOST)
        further = tf.reduce_sum(tf.cast(scores > 0, tf.int32))
        before = found._replace(area=tf.where(counts, found.area, 0.0))
        where = tf.gather(candidates.box, order)
        more = find_leaves(levels, size, where, further, network, side=side, params=params, before=before)
        # New ones come first.
        added = tf.reduce_sum(tf.cast(more.area > 0, tf.int32) - tf.cast(before.area > 0, tf.int32))
        alike = look_alike(measure_colours(paint_leaves(overview, more, more.area > 0), things.lab))
        alike &= ~reaches_border(more.box, size, margin)
        kept = (tf.range(MAX_LEAVES) >= added) | alike
        more, counted = choose_distinct(more._replace(area=tf.where(kept, more.area, 0.0)), detector)
        return *more, counted, measure_near(candidates.leaf, paint_leaves(overview, more, counted))

    *parts, counts, near = tf.cond(
        tf.reduce_any(is_further), look_again, lambda: (*found, counts, things.near_found)
    )
    found = Found(*parts)
    return Search(found, choose_leaves(found, counts, outline), things._replace(near_found=near))


def count_uncounted(
    things: Things,
    agreement: tf.Tensor,
    *,
    least: float,
    cell_px: float,
    on_sheet: float,
    params: CloseLookParams,
    outline: LeafOutlineParams,
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return how many of the `things` on the sheet are none of the leaves, and their area in frame pixels.

    The sheet is where `agreement` [C, C] is above the `least`. See `uncounted_things.find_uncounted`.
    """
    candidates = things.found
    may_be = (candidates.area > 0) & (things.near_found < params.detector.colour.found_share)

    def judge() -> tuple[tf.Tensor, tf.Tensor]:
        looks_made, looks_round = judge_shapes(candidates, outline)
        lies = measure_share_on(candidates, agreement, least=least, cell_px=cell_px) >= on_sheet
        is_left = may_be & lies & ~looks_made & ~looks_round
        area = tf.reduce_sum(tf.where(is_left, candidates.area, 0.0))
        return tf.reduce_sum(tf.cast(is_left, tf.int32)), area

    return tf.cond(tf.reduce_any(may_be), judge, lambda: (tf.constant(0), tf.constant(0.0)))
