"""What lies around leaves, inside a graph: whether it is the ruled sheet, and whether something touches them.

The rules and their thresholds are those of `estimators.sheet_colour` and `estimators.leaf_surroundings`, at
the network's resolution, with squares for discs.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.graph.close_looks import MAX_LEAVES
from laesi_tf.estimators.graph.components import grow_mask
from laesi_tf.estimators.graph.overview_colours import Overview, to_lab
from laesi_tf.estimators.leaf_surroundings import DARKEST_LEVEL, SurroundingsParams
from laesi_tf.estimators.sheet_colour import SheetColourParams

_STRIDE = 2
"""Medians are of every second row and column."""
_INNER_CELLS = 2
"""So many cells at the border of the ruling show some of what lies beside it."""


class Likeness(NamedTuple):
    """How alike the surroundings of leaves are to the sheet, [MAX_LEAVES] each."""

    share: tf.Tensor
    """Share of the surroundings that has the sheet's colour."""
    is_known: tf.Tensor
    """False where too little is seen of either."""


def measure_likeness(
    overview: Overview, painted: tf.Tensor, is_ruled: tf.Tensor, cell_px: float, params: SheetColourParams
) -> Likeness:
    """Return the share of what surrounds each leaf that has the colour of the sheet beside it.

    `painted` [L, s, s] are the leaves, of which those that exist come first, `is_ruled` [C, C] are the cells,
    `cell_px` frame pixels wide, that show the ruling.
    """
    side = overview.image.shape[0]
    scale = side / params.side_px
    first, last = (round(scale * distance) for distance in params.ring_px)
    window = round(scale * params.window_px) | 1
    lab = to_lab(tf.nn.avg_pool2d(overview.image[None], window, 1, "SAME")[0] / 255)
    is_bare = overview.shown * (1 - grow_mask(tf.reduce_max(painted, 0), first))
    inner = 1 - grow_mask(1 - tf.cast(is_ruled, tf.float32), _INNER_CELLS)
    centres = (np.arange(side, dtype=np.float32) + 0.5) / side * overview.square.side
    columns, rows = (
        tf.cast(tf.clip_by_value((low + centres) / cell_px, 0.0, is_ruled.shape[0] - 1.0), tf.int32)
        for low in (overview.square.left, overview.square.top)
    )
    is_sheet = tf.gather(tf.gather(inner, rows, axis=0), columns, axis=1) * is_bare
    places = np.arange(side, dtype=np.float32) + 0.5
    number = tf.reduce_sum(tf.cast(tf.reduce_max(painted, [1, 2]) > 0, tf.int32))

    def compare(turn: tf.Tensor, shares: tf.Tensor, known: tf.Tensor) -> tuple[tf.Tensor, ...]:
        leaf = tf.gather(painted, turn)
        reach = params.near * tf.sqrt(tf.reduce_sum(leaf)) + last
        along, down = (
            tf.cast(
                (places > tf.reduce_min(tf.where(line > 0, places, 1e4)) - reach)
                & (places < tf.reduce_max(tf.where(line > 0, places, -1e4)) + reach),
                tf.float32,
            )
            for line in (tf.reduce_max(leaf, 0), tf.reduce_max(leaf, 1))
        )
        is_near = is_sheet * along * down[:, None]
        beside = tf.where(tf.reduce_sum(is_near) > 0, is_near, is_sheet)
        expected = find_median(lab, beside)
        ring = grow_mask(leaf, last) * is_bare
        tint = tf.reduce_max(tf.abs(lab[..., 1:] - expected[1:]), -1)
        shade = tf.abs(tf.math.log(tf.maximum(lab[..., 0], 1.0) / tf.maximum(expected[0], 1.0)))
        alike = tf.cast((tint < params.max_tint) & (shade < params.max_shade), tf.float32)
        total = tf.reduce_sum(ring)
        here = tf.one_hot(turn, MAX_LEAVES)
        is_known = tf.cast((total > 0) & (tf.reduce_sum(is_sheet) > 0), tf.float32)
        share = tf.reduce_sum(ring * alike) / tf.maximum(total, 1.0)
        return turn + 1, shares + here * share, known + here * is_known

    start = (tf.constant(0), tf.zeros([MAX_LEAVES]), tf.zeros([MAX_LEAVES]))
    _, shares, known = tf.while_loop(
        lambda turn, *_: turn < number, compare, start, maximum_iterations=MAX_LEAVES
    )
    return Likeness(shares, known > 0)


def choose_on_sheet(
    counts: tf.Tensor,
    share_on: tf.Tensor,
    likeness: Likeness,
    *,
    on_sheet: float,
    is_cut_off: tf.Tensor,
    params: SheetColourParams,
) -> tf.Tensor:
    """Return which of the leaves that `counts` [L], the largest first, lie on the sheet: none if the largest
    lies on something else within it; see `RulingEstimator`.

    `share_on` [L] is the share of each on the ruled part, `is_cut_off` [L] whether the photo cuts it off.
    """
    is_within = counts & (share_on >= on_sheet)
    is_other = likeness.is_known & (likeness.share < params.least_share_within)
    is_alike = likeness.is_known & (likeness.share >= params.least_share) & ~is_cut_off
    lies = counts & tf.where(is_within, ~is_other | is_alike, is_alike)
    # Of what lies within the ruled part on something else, nothing larger must lie on the sheet.
    numbers = tf.cumsum(tf.cast(lies, tf.int32), exclusive=True)
    spoils = tf.reduce_any(is_within & is_other & tf.equal(numbers, 0))
    return lies & ~spoils


def is_touched(image: tf.Tensor, leaf: tf.Tensor, seen: tf.Tensor, params: SurroundingsParams) -> tf.Tensor:
    """Return whether something other than paper touches the leaf, 1 in `leaf` [s, s], on `image` [s, s, 3].

    `seen` [s, s] is 1 on the photo but for other leaves. See `leaf_surroundings.is_touched`.
    """
    outside = (1 - leaf)[..., None]
    side = int(params.window) | 1
    averaged = tf.nn.avg_pool2d(tf.concat([image * outside, outside], -1)[None], side, 1, "SAME")[0]
    weight = averaged[..., 3]
    usable = seen * tf.cast(weight > 1 / 3, tf.float32)
    near = grow_mask(leaf, round(params.touching_to))
    touching = (near - grow_mask(leaf, round(params.touching_from))) * usable
    around = (grow_mask(leaf, round(params.around_to)) - near) * usable
    levels = tf.math.log(tf.maximum(averaged[..., :3] / tf.maximum(weight, 1 / 3)[..., None], DARKEST_LEVEL))
    difference = levels - find_median(levels, around)
    brightness = tf.reduce_mean(difference, -1)
    tint = tf.sqrt(tf.reduce_sum((difference - brightness[..., None]) ** 2, -1))
    is_other = (
        (tint > params.max_tint) | (brightness > params.max_brightening) | (brightness < -params.max_shade)
    )
    total = tf.reduce_sum(touching)
    share = tf.reduce_sum(touching * tf.cast(is_other, tf.float32)) / tf.maximum(total, 1.0)
    return (tf.minimum(total, tf.reduce_sum(around)) >= params.min_samples) & (share > params.max_share)


def find_median(values: tf.Tensor, mask: tf.Tensor) -> tf.Tensor:
    """Return the median [C] of `values` [s, s, C] where `mask` [s, s] is 1, at every second pixel."""
    grid = (slice(None, None, _STRIDE),) * 2
    chosen = tf.reshape(mask[grid], [-1]) > 0
    columns = tf.transpose(tf.reshape(values[grid], [-1, values.shape[-1]]))
    order = tf.sort(tf.where(chosen, columns, 1e9), axis=-1)
    count = tf.reduce_sum(tf.cast(chosen, tf.int32))
    return tf.gather(order, tf.maximum(count - 1, 0) // 2, axis=1)
