"""Fill gaps in a leaf that do not show paper, inside a graph: gloss on a leaf is pale, too.

The rule and its thresholds are those of `estimators.mask_refinement`.
"""

import tensorflow as tf

from laesi_tf.estimators.graph.components import grow_mask, label_mask
from laesi_tf.estimators.mask_refinement import MaskRefinementParams

_SURE = 0.9
"""Probability below which an enclosed pixel belongs to a gap."""
_PAPER = 0.1
"""Probability below which a pixel may be paper."""
_PAPER_FROM, _PAPER_TO = 2, 12
"""Distance in network pixels from the leaf at which its paper is looked at."""


def fill_gloss(leaf: tf.Tensor, image: tf.Tensor, params: MaskRefinementParams) -> tf.Tensor:
    """Return `leaf` [s, s], probabilities, with 1 in gaps that are not like paper on `image` [s, s, 3]."""
    sure = tf.cast(leaf >= _SURE, tf.float32)
    gaps = _find_enclosed(sure) * (1 - sure)
    labels = label_mask(gaps)
    side = leaf.shape[0]
    indices = tf.reshape(tf.cast(labels, tf.int32), [-1, 1])
    # What is enclosed on four sides but has a neighbour that is not is a bay.
    beyond = grow_mask((1 - gaps) * (1 - sure), 1) * gaps
    parts = [gaps[..., None], beyond[..., None], image * gaps[..., None], image**2 * gaps[..., None]]
    sums = tf.scatter_nd(indices, tf.reshape(tf.concat(parts, -1), [-1, 8]), [side * side + 1, 8])
    count = tf.maximum(sums[:, 0], 1.0)[:, None]
    mean = sums[:, 2:5] / count
    deviation = tf.sqrt(tf.maximum(sums[:, 5:] / count - mean**2, 0.0))
    paper_mean, paper_sd = _describe_paper(leaf, image)
    red, green, blue = tf.unstack(mean / tf.maximum(paper_mean, 1.0), axis=1)
    shows_ruling = tf.reduce_mean(deviation, 1) >= params.hole_min_contrast * tf.reduce_mean(paper_sd)
    is_green = green > params.hole_max_green * tf.sqrt(red * blue)
    is_paper = shows_ruling & ~is_green & (green <= params.hole_max_brightness)
    fills = tf.cast(~is_paper & (sums[:, 1] < 0.5), tf.float32)
    filled = tf.reshape(tf.gather(fills, tf.reshape(indices, [-1])), [side, side]) * gaps
    return tf.maximum(leaf, filled)


def _find_enclosed(mask: tf.Tensor) -> tf.Tensor:
    """Return 1 where `mask` [s, s] of 0 and 1 has a pixel to the left, right, above and below."""
    enclosed = tf.ones_like(mask)
    for axis in (0, 1):
        before = tf.cumsum(mask, axis)
        after = tf.reduce_sum(mask, axis, keepdims=True) - before
        enclosed *= tf.cast((before > 0.5) & (after > 0.5), tf.float32)
    return enclosed


def _describe_paper(leaf: tf.Tensor, image: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return mean and standard deviation [3] of the colours of the paper beside a leaf."""
    faint = tf.cast(leaf > _PAPER, tf.float32)
    weight = (grow_mask(faint, _PAPER_TO) - grow_mask(faint, _PAPER_FROM))[..., None]
    total = tf.maximum(tf.reduce_sum(weight), 1.0)
    mean = tf.reduce_sum(image * weight, [0, 1]) / total
    variance = tf.reduce_sum(image**2 * weight, [0, 1]) / total - mean**2
    return mean, tf.sqrt(tf.maximum(variance, 0.0))
