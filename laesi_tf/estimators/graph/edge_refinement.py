"""Refine a leaf's mask inside a graph, to twice the network's resolution, by the colours of leaf and paper.

The rules, their order and their thresholds are those of `estimators.mask_refinement` and
`estimators.colour_model`. Discs are squares here, and the annulus of paper around a leaf has one width: a
graph has no distance transform. Petioles are not followed beyond the band around the network's outline.
"""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.estimators.colour_model import MIN_VARIANCE, PRIOR_WEIGHT, SHRINKAGE, ColourModelParams
from laesi_tf.estimators.graph.close_looks import MAX_LEAVES, Found, MaskNetwork
from laesi_tf.estimators.graph.components import grow_mask
from laesi_tf.estimators.graph.crops import Square, cut_square, interpolate_square, show_square
from laesi_tf.estimators.graph.surroundings import is_touched
from laesi_tf.estimators.leaf_candidates import LeafDetectorParams
from laesi_tf.estimators.leaf_outline import LeafOutlineParams
from laesi_tf.estimators.mask_refinement import MaskRefinementParams
from laesi_tf.estimators.ruling.least_squares import solve_normal

FINE = 2
"""Pixels of the refined mask per pixel of the network."""
_ANNULUS_PX = 16
"""Width of the annulus of paper in network pixels: `ColourModelParams.annulus_width` of a leaf that fills two
thirds of its crop's side, half as wide as long."""
_ROUNDS = 8
"""Steps in which what is connected to the network's mask is found: a little more than the band is wide."""


class Refined(NamedTuple):
    """Leaves with refined masks."""

    found: Found
    """Its `leaf` [L, s, s] is the share of each network pixel that is leaf."""
    expected_errors: tf.Tensor
    """[L], expected number of misclassified fine pixels."""
    is_touched: tf.Tensor
    """[L], whether something other than paper touches the leaf."""


def refine_leaves(
    levels: list[tf.Tensor],
    size: tf.Tensor,
    found: Found,
    count: tf.Tensor,
    network: MaskNetwork,
    params: LeafDetectorParams,
    outline: LeafOutlineParams,
) -> Refined:
    """Refine the first `count` leaves on a photo of `size` [2], see `find_leaves`."""
    side = found.leaf.shape[1]

    def refine(
        turn: tf.Tensor, leaves: tf.Tensor, errors: tf.Tensor, touched: tf.Tensor
    ) -> tuple[tf.Tensor, ...]:
        left, top, wide = tf.unstack(tf.gather(found.square, turn))
        ends = tf.reverse(size, [0])
        corner = tf.stack([left, top])
        shown = tf.concat([tf.maximum(corner, 0.0), tf.minimum(corner + wide, ends)], 0)
        square = Square(left, top, wide, shown)
        own = tf.gather(leaves, turn)
        # Of the mirrored crop, the network's errors are partly other ones.
        crop = cut_square(levels, square, side)
        again = tf.reverse(network(tf.reverse(crop, [1])[None])[0, ..., 0], [1])
        near = grow_mask(tf.cast(own > 0, tf.float32), 1)
        probability = (own + again * near) / 2
        shown_px = show_square(square, side)
        others = tf.cast(again >= params.overview_probability, tf.float32) * (1 - near)
        image = interpolate_square(levels[:FINE], square, FINE * side)
        cover, error = refine_mask(image, probability, others, shown_px, outline.refinement)
        mask = tf.cast(cover >= 0.5, tf.float32)
        touches = is_touched(crop, mask, shown_px * (1 - others), outline.surroundings)
        here = tf.one_hot(turn, MAX_LEAVES)
        leaves = tf.where(here[:, None, None] > 0, cover, leaves)
        return turn + 1, leaves, errors + here * error, touched + here * tf.cast(touches, tf.float32)

    start = (tf.constant(0), found.leaf, tf.zeros([MAX_LEAVES]), tf.zeros([MAX_LEAVES]))
    _, leaf, errors, touched = tf.while_loop(
        lambda turn, *_: turn < count, refine, start, maximum_iterations=MAX_LEAVES
    )
    return Refined(found._replace(leaf=leaf), errors, touched > 0)


def refine_mask(
    image: tf.Tensor,
    probability: tf.Tensor,
    others: tf.Tensor,
    shown: tf.Tensor,
    params: MaskRefinementParams,
) -> tuple[tf.Tensor, tf.Tensor]:
    """Refine the mask of a leaf with `probability` [s, s] on `image` [FINE s, FINE s, 3].

    `others` [s, s] are 1 on other leaves, `shown` [s, s] where the crop shows the photo, else 0. Return the
    share [s, s] of each network pixel that is leaf, and the expected number of misclassified fine pixels.
    """
    bound = params.colour.max_log_odds
    colours = fit_colour_log_odds(image, probability, shown * (1 - others), params.colour)
    network = _logit(enlarge(probability))
    weighted = params.network_weight * network
    log_odds = colours + tf.clip_by_value(weighted, -params.network_max_log_odds, params.network_max_log_odds)
    core = tf.cast(probability >= 0.5, tf.float32)
    band = round(params.band)
    deep, near = 1 - grow_mask(1 - core, band), grow_mask(core, band)
    log_odds = tf.where(_repeat(deep) > 0, bound, tf.where(_repeat(near) > 0, log_odds, -bound))
    is_free = _repeat(shown * (1 - others))
    leaf = tf.cast(log_odds > 0, tf.float32) * is_free
    connected = leaf * _repeat(core)
    for _ in range(_ROUNDS):
        connected = grow_mask(connected, 1) * leaf
    leaf = tf.where(tf.reduce_sum(connected) > 0, connected, _repeat(core))
    size = tf.abs(log_odds)
    errors = tf.where((size < bound) & (is_free > 0), 1 / (1 + tf.exp(size)), 0.0)
    cover = tf.nn.avg_pool2d(leaf[None, ..., None], FINE, FINE, "VALID")[0, ..., 0]
    return cover, tf.reduce_sum(errors)


def fit_colour_log_odds(
    image: tf.Tensor, probability: tf.Tensor, usable: tf.Tensor, params: ColourModelParams
) -> tf.Tensor:
    """Return the log-odds [FINE s, FINE s] that pixels of `image` are leaf by their colour, see
    `colour_model.fit_colour_model`; 0 with too few samples of leaf or paper.

    `probability` [s, s] is the network's, `usable` [s, s] is 1 where paper is looked at.
    """
    colours = image[FINE // 2 :: FINE, FINE // 2 :: FINE]
    leaf, annulus, near = _select_samples(probability, usable, params)
    has_samples = tf.minimum(tf.reduce_sum(leaf), tf.reduce_sum(near)) >= params.min_samples
    direction = _fit_discriminant(colours, leaf, annulus, params)
    values = tf.reduce_sum(colours * direction, -1)
    window = int(params.window) | 1
    leaf_mean, paper_mean = (_local_mean(values, mask, window) for mask in (leaf, near))
    variance = 1e-6
    for mask, mean in ((leaf, leaf_mean), (near, paper_mean)):
        apart = values - mean
        middle = _mean(apart, mask)
        variance += _mean((apart - middle) ** 2, mask) / 2
    slope = tf.where(has_samples, tf.maximum(leaf_mean - paper_mean, 0.0) / variance, 0.0)
    score = tf.reduce_sum(image * direction, -1)
    log_odds = (score - enlarge((leaf_mean + paper_mean) / 2)) * enlarge(slope)
    return tf.clip_by_value(log_odds, -params.max_log_odds, params.max_log_odds)


def _select_samples(
    probability: tf.Tensor, usable: tf.Tensor, params: ColourModelParams
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Return 1, [s, s] each, on pixels that are certainly leaf, on paper around it, and on paper close to
    it."""
    sure = tf.cast(probability > params.sure_probability, tf.float32)
    leaf = 1 - grow_mask(1 - sure, round(params.leaf_distance))
    core = tf.cast(probability >= 0.5, tf.float32)
    faint = tf.cast(probability > params.faint_probability, tf.float32)
    distance = round(params.paper_distance)
    paper = (1 - grow_mask(faint, distance)) * usable
    annulus = _grow_far(core, _ANNULUS_PX) * paper
    return leaf, annulus, grow_mask(faint, distance + round(params.local_paper_width)) * paper


def _fit_discriminant(
    colours: tf.Tensor, leaf: tf.Tensor, paper: tf.Tensor, params: ColourModelParams
) -> tf.Tensor:
    """Return Fisher's discriminant [3], of unit length, from colours of paper, in several shades, to leaf."""
    flat = tf.reshape(colours, [-1, 3])
    leaf_mean, leaf_squares = _find_moments(flat, leaf)
    bare_mean, bare_squares = _find_moments(flat, paper)
    shades = params.shades
    paper_mean = bare_mean * (sum(shades) / len(shades))
    paper_squares = bare_squares * (sum(shade**2 for shade in shades) / len(shades))
    scatter = (
        leaf_squares - leaf_mean[:, None] * leaf_mean + paper_squares - paper_mean[:, None] * paper_mean
    ) / 2
    identity = tf.eye(3)
    scatter += identity * (SHRINKAGE * tf.reduce_sum(scatter * identity) / 3 + MIN_VARIANCE)
    direction = solve_normal(scatter, (leaf_mean - paper_mean)[:, None])[0][:, 0]
    return direction / (tf.sqrt(tf.reduce_sum(direction**2)) + 1e-9)


def _find_moments(colours: tf.Tensor, mask: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the mean [3] of `colours` [n, 3] where `mask`, and the mean [3, 3] of their products."""
    weight = tf.reshape(mask / tf.maximum(tf.reduce_sum(mask), 1.0), [-1, 1])
    mean = tf.reduce_sum(colours * weight, 0)
    return mean, tf.matmul(colours * weight, colours, transpose_a=True)


def _local_mean(values: tf.Tensor, mask: tf.Tensor, window: int) -> tf.Tensor:
    """Return the mean of `values` [s, s] over the pixels of `mask` in a window around each pixel."""
    both = tf.stack([mask, values * mask], -1)[None]
    count, total = tf.unstack(tf.nn.avg_pool2d(both, window, 1, "SAME")[0], axis=-1)
    return (total + PRIOR_WEIGHT * _mean(values, mask)) / (count + PRIOR_WEIGHT)


def _mean(values: tf.Tensor, mask: tf.Tensor) -> tf.Tensor:
    return tf.reduce_sum(values * mask) / tf.maximum(tf.reduce_sum(mask), 1.0)


def _grow_far(mask: tf.Tensor, reach: int) -> tf.Tensor:
    """Return `grow_mask`, first down and then across, as a large window takes long."""
    wide = 2 * reach + 1
    down = tf.nn.max_pool2d(mask[None, ..., None], [wide, 1], 1, "SAME")
    return tf.nn.max_pool2d(down, [1, wide], 1, "SAME")[0, ..., 0]


def enlarge(values: tf.Tensor) -> tf.Tensor:
    """Return `values` [s, s] at FINE times the resolution, interpolated."""
    side = FINE * values.shape[0]
    return tf.image.resize(values[None, ..., None], [side, side])[0, ..., 0]


def _repeat(values: tf.Tensor) -> tf.Tensor:
    """Return `values` [s, s] at FINE times the resolution, each repeated."""
    side = values.shape[0]
    wide = tf.tile(values[:, None, :, None], [1, FINE, 1, FINE])
    return tf.reshape(wide, [FINE * side, FINE * side])


def _logit(probability: tf.Tensor) -> tf.Tensor:
    bounded = tf.clip_by_value(probability, 1e-4, 1 - 1e-4)
    return tf.math.log(bounded / (1 - bounded))
