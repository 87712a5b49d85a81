"""Patches cut from a working picture of fixed size, upright as it is or straightened by a lattice."""

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.spectra import SIDE, flattened

PICTURE = 1536
"""Side of the working picture, pixels: 1 mm is then at least 5 pixels in views up to 30 cm."""
CELL = 16
"""Side of the squares that coverage is told in, pixels."""
PLACES, COUNT = 6, 25
"""Candidates along each axis, and how many patches are kept: the barest."""
_BARE = 0.4
"""Patches that are covered more than this are left out."""


def choose(covered: tf.Tensor, size: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Corners int [COUNT, 2] (y, x) of the barest patches, and 1 for those that are bare enough, [COUNT].

    `covered` float [PICTURE / CELL, PICTURE / CELL] in 0..1, `size` int [2] is the height and width in use.
    """
    steps = tf.linspace(0.0, 1.0, PLACES)[:, None] * tf.cast(size - SIDE, tf.float32)
    rows, columns = tf.unstack(tf.cast(steps / CELL, tf.int32), axis=1)
    cells = SIDE // CELL
    share = tf.nn.avg_pool2d(covered[None, :, :, None], cells, 1, "VALID")[0, :, :, 0]
    share = tf.reshape(tf.gather(tf.gather(share, rows), columns, axis=1), [-1])
    # Where more are bare than are kept, those that are left out lie scattered.
    order = np.random.default_rng(0).permutation(PLACES**2).astype(np.float32)
    best = tf.math.top_k(-tf.nn.relu(share - 0.1) - 1e-4 * order, COUNT).indices
    corners = tf.stack([tf.gather(rows, best // PLACES), tf.gather(columns, best % PLACES)], axis=1) * CELL
    return corners, tf.cast(tf.gather(share, best) < _BARE, tf.float32)


def cut(picture: tf.Tensor, corners: tf.Tensor) -> tf.Tensor:
    """Patches float [COUNT, SIDE, SIDE, 3] of `picture` uint8 [PICTURE, PICTURE, 3] at corners [COUNT, 2]."""
    pieces = tf.reshape(picture, [PICTURE * PICTURE // CELL, CELL * 3])
    row = (corners[:, :1] + np.arange(SIDE)) * (PICTURE // CELL)
    index = row[:, :, None] + (corners[:, 1] // CELL)[:, None, None] + np.arange(SIDE // CELL)
    return tf.reshape(tf.cast(tf.gather(pieces, index), tf.float32), [-1, SIDE, SIDE, 3])


def straightened(
    picture: tf.Tensor, size: tf.Tensor, lattice: tf.Tensor, centres: tf.Tensor, half: tf.Tensor, rate: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Patches float [K, SIDE, SIDE, 3] seen straight on, and where they are in the picture [K, SIDE, SIDE].

    `centres` [K, 2] are the patches' middles in the straightened picture: periods of `lattice` [6] over
    `rate`. Pixels are the nearest: the error is noise without lines of its own.
    """
    steps = (np.arange(SIDE, dtype=np.float32) + 0.5 - SIDE / 2) / half * rate
    x = (centres[:, :1] * rate + steps)[:, None, :]
    y = (centres[:, 1:] * rate + steps)[:, :, None]
    u, v = located(lattice, x, y)
    height, width = tf.unstack(tf.cast(size, tf.float32))
    column, row = tf.floor(u * half + width / 2), tf.floor(v * half + height / 2)
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    column, row = tf.clip_by_value(column, 0, width - 1), tf.clip_by_value(row, 0, height - 1)
    index = tf.cast(row, tf.int32) * PICTURE + tf.cast(column, tf.int32)
    pixels = tf.gather(tf.reshape(picture, [-1, 3]), index)
    return tf.cast(pixels, tf.float32), tf.cast(inside, tf.float32)


def located(lattice: tf.Tensor, x: tf.Tensor, y: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Where in the picture, in units, the lattice [6] has the coordinates `x`, `y` in periods."""
    a, b, d, e, g, h = tf.unstack(lattice)
    # (a - g x) u + (b - h x) v = x, and the same of y.
    p, q, r, s = a - g * x, b - h * x, d - g * y, e - h * y
    determinant = p * s - q * r
    return (x * s - q * y) / determinant, (p * y - r * x) / determinant


def ink(patches: tf.Tensor) -> tf.Tensor:
    """Flattened contrast [K, SIDE, SIDE] of patches [K, SIDE, SIDE, 3].

    The darkest channel shows ink of any colour, on white as on tinted paper.
    """
    return flattened(tf.reduce_min(patches, axis=-1))
