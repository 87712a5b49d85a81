"""Polygons to coverage: how much of each pixel a shape covers, exactly, for any simple polygon.

The accumulation method of font rasterizers: each short edge adds its signed height to the pixel that it
crosses, and a running sum along the row turns edges into area. The total over the picture equals the
polygon's shoelace area to rounding, which is what ties the mask to the label.
Points are [n, 2] float32 (x right, y down), in pixels, pixel (i, j) covering [j, j+1] x [i, i+1].
"""

import numpy as np
import tensorflow as tf

_BLOCK = 16
_ROWS = 3


def area(points: tf.Tensor) -> tf.Tensor:
    """Signed area of the closed polygon `points` [..., n, 2] (shoelace): positive when clockwise on screen."""
    x, y = tf.unstack(points, axis=-1)
    next_x, next_y = tf.unstack(_next(points), axis=-1)
    return 0.5 * tf.reduce_sum(x * next_y - y * next_x, axis=-1)


def _next(points: tf.Tensor) -> tf.Tensor:
    """The successor of each point of closed polygons [..., n, 2]; tf.roll is ten times slower."""
    return tf.concat([points[..., 1:, :], points[..., :1, :]], axis=-2)


def subdivide(points: tf.Tensor, pieces: int) -> tf.Tensor:
    """Cut each edge of closed polygons [..., n, 2] into `pieces` equal ones: [..., n * pieces, 2]."""
    if pieces == 1:
        return points
    fraction = tf.range(pieces, dtype=tf.float32)[:, None] / pieces
    ends = _next(points)
    fine = points[..., None, :] * (1 - fraction) + ends[..., None, :] * fraction
    return tf.reshape(fine, [*points.shape[:-2], points.shape[-2] * pieces, 2])


def resample(points: tf.Tensor, count: int) -> tf.Tensor:
    """`count` points [count, 2] at equal distances along the closed polygon `points` [n, 2]."""
    ring = tf.concat([points, points[:1]], axis=0)
    lengths = tf.norm(ring[1:] - ring[:-1], axis=-1)
    travelled = tf.concat([[0.0], tf.cumsum(lengths)], axis=0)
    wanted = tf.range(count, dtype=tf.float32) * (travelled[-1] / count)
    left = tf.minimum(tf.searchsorted(travelled, wanted, side="right"), tf.shape(points)[0]) - 1
    fraction = tf.math.divide_no_nan(wanted - tf.gather(travelled, left), tf.gather(lengths, left))
    start = tf.gather(ring, left)
    return start + fraction[:, None] * (tf.gather(ring, left + 1) - start)


def segments(points: tf.Tensor) -> tf.Tensor:
    """Directed edges [..., n, 2 ends, 2] of closed polygons [..., n, 2]."""
    return tf.stack([points, _next(points)], axis=-2)


def fill(edges: tf.Tensor, size: tuple[int, int]) -> tf.Tensor:
    """Coverage float32 [H, W] of the closed loops whose directed `edges` are [n, 2 ends, 2].

    Loops add where they turn alike and cancel where they turn oppositely, so a hole is a loop that turns the
    other way. Edges must be at most two pixels high, so that none crosses more than three rows; parts
    outside the picture are cut off correctly.
    """
    height, width = size
    padded = -(-(width + 1) // _BLOCK) * _BLOCK
    cells, heights = _deposits(edges, height, width, padded)
    edge_heights = tf.math.unsorted_segment_sum(heights, cells, height * padded)
    return _running_sum(tf.reshape(edge_heights, [height, padded]))[:, :width]


def shape(points: tf.Tensor, size: tuple[int, int]) -> tf.Tensor:
    """Coverage [H, W] in [0, 1] of the union of closed polygons [..., n, 2] that all turn the same way."""
    edges = tf.reshape(segments(points), [-1, 2, 2])
    return tf.minimum(tf.abs(fill(edges, size)), 1)


def _deposits(edges: tf.Tensor, height: int, width: int, padded: int) -> tuple[tf.Tensor, tf.Tensor]:
    """Where each edge leaves how much of its height: flat cells int32 [6n] (-1 outside), heights [6n].

    An edge is clipped to each of the rows that it crosses; each part is shared between the pixel that holds
    its middle and the next one so that the area left of the middle is exact.
    """
    x0, y0, x1, y1 = tf.unstack(tf.reshape(edges, [-1, 4]), axis=1)
    rows = tf.floor(tf.minimum(y0, y1)) + tf.range(_ROWS, dtype=tf.float32)[:, None]
    start, end = (tf.maximum(tf.minimum(y, rows + 1), rows) for y in (y0, y1))
    slope = tf.math.divide_no_nan(x1 - x0, y1 - y0)
    middle = x0 + slope * ((start + end) * 0.5 - y0)
    middle = tf.clip_by_value(middle, 0, width - 1e-3)
    column = tf.floor(middle)
    rise = end - start
    beyond = rise * (middle - column)
    cell = tf.cast(rows * padded + column, tf.int32)
    visible = (rows >= 0) & (rows < height)
    cells = tf.stack([tf.where(visible, cell, -1), tf.where(visible, cell + 1, -1)])
    return tf.reshape(cells, [-1]), tf.reshape(tf.stack([rise - beyond, beyond]), [-1])


def _running_sum(rows: tf.Tensor) -> tf.Tensor:
    """Cumulative sum along the rows [H, W] (W a multiple of 16): sixfold faster than tf.cumsum on a CPU."""
    height, width = rows.shape
    triangle = tf.constant(np.triu(np.ones((_BLOCK, _BLOCK), np.float32)))
    within = tf.reshape(tf.reshape(rows, [-1, _BLOCK]) @ triangle, [height, width // _BLOCK, _BLOCK])
    before = tf.cumsum(within[:, :, -1], axis=1, exclusive=True)
    return tf.reshape(within + before[:, :, None], [height, width])
