"""Connected components of a network's mask inside a graph, by max-pooling of labels."""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

MOST = 16
"""Components of one mask that are kept: the largest ones."""
_COARSE = 2
"""Labels have so many pixels of the mask per pixel: the mask network's own are four wide."""


def grow_mask(mask: tf.Tensor, reach: int) -> tf.Tensor:
    """Return `mask` [s, s] grown by `reach` pixels on each side."""
    return tf.nn.max_pool2d(mask[None, ..., None], 2 * reach + 1, 1, "SAME")[0, ..., 0]


def find_ends(flags: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return where the ones of `flags` [..., n], float, begin and end, [...] each: n and 0 without any."""
    count = flags.shape[-1]
    places = np.arange(count, dtype=np.float32)
    return count - tf.reduce_max(flags * (count - places), -1), tf.reduce_max(flags * (places + 1), -1)


class Components(NamedTuple):
    """The largest components of a mask, in falling order."""

    count: tf.Tensor
    """[MOST], pixels of each; 0 where there are no more."""
    boxes: tf.Tensor
    """[MOST, 4], left, top, right, bottom in pixels of the mask."""
    labels: tf.Tensor
    """[s / 2, s / 2], float, the label of each pixel or 0."""
    ids: tf.Tensor
    """[MOST], the label of each component."""

    def select(self, index: tf.Tensor, mask: tf.Tensor) -> tf.Tensor:
        """Return where `mask`, float [s, s] of 0 and 1, belongs to component `index`, float [s, s]."""
        own = tf.cast(tf.equal(self.labels, tf.gather(self.ids, index)), tf.float32)
        side = mask.shape[0]
        wide = tf.reshape(tf.tile(own[:, None, :, None], [1, _COARSE, 1, _COARSE]), [side, side])
        return wide * mask


def label_mask(mask: tf.Tensor) -> tf.Tensor:
    """Return labels, float [s, s], of the 8-connected components of `mask`, float [s, s] of 0 and 1.

    Each pixel gets the largest index of its component: labels spread to neighbours, and from there to
    whatever label the pixel has that they name, so that long components take few rounds.
    """
    side = mask.shape[0]
    start = tf.reshape(tf.range(1, side * side + 1, dtype=tf.float32), [side, side]) * mask

    def spread(labels: tf.Tensor, _: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        new = labels
        for _ in range(4):
            new = tf.nn.max_pool2d(new[None, ..., None], 3, 1, "SAME")[0, ..., 0] * mask
        known = tf.concat([[0.0], tf.reshape(new, [-1])], 0)
        new = tf.gather(known, tf.cast(new, tf.int32))
        return new, tf.reduce_max(tf.abs(new - labels))

    return tf.while_loop(
        lambda _, change: change > 0, spread, (start, tf.constant(1.0)), maximum_iterations=side
    )[0]


def find_components(mask: tf.Tensor) -> Components:
    """Return the largest components of `mask`, float [s, s] of 0 and 1; s is even.

    Components less than two pixels apart may count as one.
    """
    side = mask.shape[0] // _COARSE
    coarse = tf.nn.max_pool2d(mask[None, ..., None], _COARSE, _COARSE, "VALID")[0, ..., 0]
    pixels = tf.nn.avg_pool2d(mask[None, ..., None], _COARSE, _COARSE, "VALID")[0, ..., 0] * _COARSE**2
    labels = label_mask(coarse)
    indices = tf.reshape(tf.cast(labels, tf.int32), [-1, 1])
    counts = tf.scatter_nd(indices, tf.reshape(pixels, [-1]), [side * side + 1])
    count, best = tf.math.top_k(counts, MOST)
    ids = tf.cast(best, tf.float32)
    own = tf.cast(tf.equal(labels, ids[:, None, None]), tf.float32) * tf.sign(coarse)
    (left, right), (top, bottom) = (find_ends(tf.reduce_max(own, axis)) for axis in (1, 2))
    boxes = tf.stack([left, top, right, bottom], 1) * _COARSE
    return Components(count, boxes, labels, ids)
