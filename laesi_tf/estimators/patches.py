"""Patches cut from a working picture of fixed size, upright as it is or straightened by a lattice.

The picture is uint8 [PICTURE, PICTURE, 4]: colour, and 255 where paper may be seen, 0 on the leaf and beyond the
photo, which fills the top left corner.
"""

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.spectra import SIDE, local_mean

PICTURE = 1536
"""Side of the working picture, pixels: 1 mm is then at least 5 pixels in views up to 30 cm."""
FINE, WIDE = 16, 9
"""Patches at full resolution, and patches at half of it that show twice as much: together they resolve the
millimetres of a wide view and the centimetres of a close one."""
COUNT = FINE + WIDE
_PLACES = 6
"""Candidates for a fine patch along each axis: the barest are kept."""
_CELL = 16
"""Pixels that corners are rounded to, and that coverage is sampled at."""
_BARE = 0.6
"""Least share of bare paper in a patch."""


def chosen(picture: tf.Tensor, size: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Patches float [COUNT, SIDE, SIDE, 4] of a photo of `size` int [2] (height, width), their middles (x, y) in
    pixels [COUNT, 2], and the pixels that one of theirs stands for [COUNT]."""
    order = np.random.default_rng(0).permutation(_PLACES**2).astype(np.float32)
    places = _corners(size, _PLACES, SIDE)
    cells = SIDE // _CELL
    bare = tf.cast(picture[None, ::_CELL, ::_CELL, 3:], tf.float32) / 255
    share = tf.nn.avg_pool2d(bare, cells, 1, "VALID")[0, :, :, 0]
    share = tf.gather_nd(share, places // _CELL)
    # Where more are bare than are kept, those that are left out lie scattered.
    best = tf.math.top_k(tf.minimum(share, 0.9) - 1e-4 * order, FINE).indices
    fine, wide = tf.gather(places, best), _corners(size, 3, 2 * SIDE)
    large = _cut(picture, wide, 2 * SIDE)
    halved = (large[:, ::2, ::2] + large[:, 1::2, 1::2]) / 2
    patches = tf.concat([_cut(picture, fine, SIDE), halved], axis=0)
    steps = np.repeat(np.float32([1, 2]), [FINE, WIDE])
    middles = tf.cast(tf.reverse(tf.concat([fine, wide], axis=0), [1]), tf.float32) + SIDE / 2 * steps[:, None]
    return patches, middles, tf.constant(steps)


def _corners(size: tf.Tensor, count: int, side: int) -> tf.Tensor:
    """Corners int [count * count, 2] (y, x) of squares of `side` pixels, evenly over the photo."""
    last = tf.cast(tf.maximum(size - side, 0), tf.float32)
    steps = np.linspace(0, 1, count, dtype=np.float32)
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    return tf.cast(grid * last / _CELL, tf.int32) * _CELL


def _cut(picture: tf.Tensor, corners: tf.Tensor, side: int) -> tf.Tensor:
    """Squares float [n, side, side, 4] of `picture` at corners [n, 2], multiples of a cell."""
    pieces = tf.reshape(picture, [PICTURE * PICTURE // _CELL, _CELL * 4])
    row = (corners[:, :1] + np.arange(side, dtype=np.int32)) * (PICTURE // _CELL)
    across = np.arange(side // _CELL, dtype=np.int32)
    index = row[:, :, None] + (corners[:, 1] // _CELL)[:, None, None] + across
    return tf.reshape(tf.cast(tf.gather(pieces, index), tf.float32), [-1, side, side, 4])


def straightened(
    picture: tf.Tensor, size: tf.Tensor, lattice: tf.Tensor, middles: tf.Tensor, step: tf.Tensor
) -> tf.Tensor:
    """Patches float [K, SIDE, SIDE, 4] seen straight on.

    `middles` [K, 2] and the distance `step` of samples are in periods of `lattice` [6]. Pixels are the nearest:
    the error is noise without lines of its own.
    """
    offsets = (np.arange(SIDE, dtype=np.float32) + 0.5 - SIDE / 2) * step
    x = (middles[:, :1] + offsets)[:, None, :]
    y = (middles[:, 1:] + offsets)[:, :, None]
    u, v = _located(lattice, x, y)
    height, width = tf.unstack(tf.cast(size, tf.float32))
    half = tf.maximum(height, width) / 2
    column, row = tf.floor(u * half + width / 2), tf.floor(v * half + height / 2)
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    index = tf.cast(tf.where(inside, row * PICTURE + column, 0.0), tf.int32)
    pixels = tf.cast(tf.gather(tf.reshape(picture, [-1, 4]), index), tf.float32)
    return tf.where(inside[..., None], pixels, 0.0)


def _located(lattice: tf.Tensor, x: tf.Tensor, y: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Where in the picture, in units, `lattice` [6] has the coordinates `x`, `y` in periods."""
    a, b, d, e, g, h = tf.unstack(lattice)
    # (a - g x) u + (b - h x) v = x, and the same of y: Cramer's rule, with what depends on one axis outside.
    p, q, r, s = a - g * x, b - h * x, d - g * y, e - h * y
    scale = 1 / (p * s - q * r)
    return (x * s - q * y) * scale, (p * y - r * x) * scale


def ink(patches: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Contrast [K, SIDE, SIDE] of patches [K, SIDE, SIDE, 4] within -3..3, and 1 for those of bare paper [K].

    It is free of shading and of one strong edge's dominance. The darkest channel shows ink of any colour, on
    white as on tinted paper.
    """
    red, green, blue, bare = tf.unstack(patches, axis=-1)
    darkest = tf.minimum(tf.minimum(red, green), blue)
    bare /= 255
    detail = (darkest - local_mean(darkest, 5, cell=8)) * bare
    spread = tf.sqrt(local_mean(detail * detail, 7, cell=8)) + 2
    share = tf.reduce_mean(bare, axis=[1, 2])
    return tf.clip_by_value(detail / spread, -3, 3), tf.cast(share > _BARE, tf.float32)
