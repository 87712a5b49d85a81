"""Patches of a working image of fixed size, as it is or rectified by a lattice.

The image is uint8 [FRAME, FRAME]: grey in 1..255 where paper may be visible, 0 on the leaf and beyond the
photo, whose upper left corner is at (BORDER, BORDER).
"""

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.photo_pyramid import OVERVIEW_SIDE_PX
from laesi_tf.estimators.ruling_reader.spectra import SIDE, local_mean

BORDER = 16
"""Blank pixels around the photo: a cell."""
FRAME = OVERVIEW_SIDE_PX + 2 * BORDER
"""Side of the working image, pixels."""
FINE, WIDE = 16, 4
"""Patches at full resolution, and patches at half of it that show twice as much: together they resolve the
millimetres of a wide view and the centimetres of a close one."""
_PLACES = 6
"""Candidates for a fine patch along each axis: those with the most bare paper are kept."""
_CELL = BORDER
"""Grid in pixels to which corners are rounded, and on which coverage is sampled."""
_BARE = 0.35
"""Least share of bare paper in a patch: covered pixels are left out; close views have few bare patches."""


def choose_patches(picture: tf.Tensor, size: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Choose patches float [K, SIDE, SIDE] of a photo of `size` int [2] (height, width).

    Also returns their middles (x, y) in pixels [K, 2], and the width of one of their pixels [K].
    """
    order = np.random.default_rng(0).permutation(_PLACES**2).astype(np.float32)
    places = _corners(size, _PLACES, SIDE)
    cells = SIDE // _CELL
    bare = tf.minimum(tf.cast(picture[None, BORDER::_CELL, BORDER::_CELL, None], tf.float32), 1)
    share = tf.nn.avg_pool2d(bare, cells, 1, "VALID")[0, :, :, 0]
    share = tf.gather_nd(share, places // _CELL)
    # Where more are bare than are kept, the omitted ones are scattered.
    best = tf.math.top_k(tf.minimum(share, 0.9) - 1e-4 * order, FINE).indices
    fine, wide = tf.gather(places, best), _corners(size, 2, 2 * SIDE)
    halved = tf.nn.avg_pool2d(_cut(picture, wide, 2 * SIDE)[..., None], 2, 2, "VALID")[..., 0]
    patches = tf.concat([_cut(picture, fine, SIDE), halved], axis=0)
    steps = np.repeat(np.array([1, 2], np.float32), [FINE, WIDE])
    middles = (
        tf.cast(tf.reverse(tf.concat([fine, wide], axis=0), [1]), tf.float32) + SIDE / 2 * steps[:, None]
    )
    return patches, middles, tf.constant(steps)


def _corners(size: tf.Tensor, count: int, side: int) -> tf.Tensor:
    """Return corners int [count * count, 2] (y, x) of squares of `side` pixels, evenly over the photo."""
    last = tf.cast(tf.maximum(size - side, 0), tf.float32)
    steps = np.linspace(0, 1, count, dtype=np.float32)
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    return tf.cast(grid * last / _CELL, tf.int32) * _CELL


def _cut(picture: tf.Tensor, corners: tf.Tensor, side: int) -> tf.Tensor:
    """Return squares float [n, side, side] of `picture` at corners [n, 2], multiples of a cell."""
    pieces = tf.reshape(picture, [FRAME * FRAME // _CELL, _CELL])
    row = (corners[:, :1] + BORDER + np.arange(side, dtype=np.int32)) * (FRAME // _CELL)
    across = BORDER // _CELL + np.arange(side // _CELL, dtype=np.int32)
    index = row[:, :, None] + (corners[:, 1] // _CELL)[:, None, None] + across
    return tf.reshape(tf.cast(tf.gather(pieces, index), tf.float32), [-1, side, side])


def rectify_patches(
    picture: tf.Tensor, size: tf.Tensor, lattice: tf.Tensor, middles: tf.Tensor, step: tf.Tensor
) -> tf.Tensor:
    """Return rectified patches float [K, SIDE, SIDE].

    `middles` [K, 2] and the distance `step` of samples are in periods of `lattice` [6]. Pixels are the
    nearest ones: the error is noise without lines of its own.
    """
    offsets = (np.arange(SIDE, dtype=np.float32) + 0.5 - SIDE / 2) * step
    x = (middles[:, :1] + offsets)[:, None, :]
    y = (middles[:, 1:] + offsets)[:, :, None]
    height, width = tf.unstack(tf.cast(size, tf.float32))
    half = tf.maximum(height, width) / 2
    a, b, d, e, g, h = tf.unstack(lattice)
    # The inverse of the lattice is its adjugate, up to a factor.
    u, v = (e * x) - (b * y), (a * y) - (d * x)
    w = 1 / tf.maximum((d * h - e * g) * x + ((b * g - a * h) * y + (a * e - b * d)), 1e-6)
    column = tf.clip_by_value(u * (w * half) + (width / 2 + BORDER), BORDER - 1, width + BORDER)
    row = tf.clip_by_value(v * (w * half) + (height / 2 + BORDER), BORDER - 1, height + BORDER)
    index = tf.cast(row, tf.int32) * FRAME + tf.cast(column, tf.int32)
    # Where no lattice was found its numbers may be NaN, which become arbitrary indices.
    index = tf.clip_by_value(index, 0, FRAME * FRAME - 1)
    return tf.cast(tf.gather(tf.reshape(picture, [-1]), index), tf.float32)


def extract_ink(patches: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the contrast [K, SIDE, SIDE] of patches in -3..3, and 1 for those of bare paper, else 0 [K].

    Shading is removed, and the influence of a single strong edge bounded.
    """
    bare = tf.minimum(patches, 1)
    # Covered pixels take the mean of the others, so that their border is no edge.
    share = tf.reduce_mean(bare, axis=[1, 2], keepdims=True)
    mean = tf.reduce_mean(patches, axis=[1, 2], keepdims=True) / tf.maximum(share, 1e-3)
    grey = patches + (1 - bare) * mean
    detail = (grey - local_mean(grey, 5, cell=8)) * bare
    spread = tf.sqrt(local_mean(detail * detail, 7, cell=8)) + 2
    return tf.clip_by_value(detail / spread, -3, 3), tf.cast(share[:, 0, 0] > _BARE, tf.float32)
