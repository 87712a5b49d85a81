"""Polygons to coverage: how much of each pixel a shape covers, exactly, for any simple polygon.

The accumulation method of font rasterizers: each short edge adds its signed height to the pixel that it
crosses, and a running sum along the row turns edges into area. The total over the picture equals the
polygon's shoelace area to rounding, which is what ties the mask to the label.
Points are [n, 2] float32 (x right, y down), in pixels, pixel (i, j) covering [j, j+1] x [i, i+1].

Three steps, since the first and the last are compiled and the second may not be: `deposits` of the directed
edges of closed loops, what is `summed` of them in each cell, and the coverage `accumulated` from that.
Loops add where they turn alike and cancel where they turn oppositely, so a hole is a loop that turns the
other way. Edges must be at most two pixels high, so that none crosses more than three rows; parts outside the
picture are cut off correctly.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.frame import Size

Sides: TypeAlias = Size | tuple[tf.Tensor, tf.Tensor]
"""Height and width of a picture, or of a window that is known when it is drawn."""
_BLOCK = 16
_ROWS = 3


class Deposits(NamedTuple):
    """Flat cells int32 [6n] of a picture and the heights [6n] that are left in them."""

    cells: tf.Tensor
    heights: tf.Tensor


def area(points: tf.Tensor) -> tf.Tensor:
    """Signed area of closed polygons [..., n, 2] (shoelace): positive when clockwise on screen."""
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
    cuts = subdivide_edges(segments(points), pieces)[:, 0]
    return tf.reshape(cuts, [*points.shape[:-2], points.shape[-2] * pieces, 2])


def subdivide_edges(edges: tf.Tensor, pieces: int) -> tf.Tensor:
    """Cut edges [..., 2 ends, 2] into `pieces` equal ones: [n * pieces, 2 ends, 2]."""
    fraction = tf.constant(np.arange(pieces + 1, dtype=np.float32) / pieces)[:, None]
    start, end = tf.split(tf.reshape(edges, [-1, 2, 2]), 2, axis=1)
    cuts = start + fraction * (end - start)
    return tf.reshape(tf.stack([cuts[:, :-1], cuts[:, 1:]], axis=2), [-1, 2, 2])


def resample(points: tf.Tensor, count: int) -> tf.Tensor:
    """`count` points [count, 2] at equal distances along the closed polygon `points` [n, 2]."""
    travelled = lengths(points)
    return spaced(points, travelled, passed(travelled, count))


def lengths(points: tf.Tensor) -> tf.Tensor:
    """Length [n + 1] of the way along the closed polygon `points` [n, 2] to each of them and to the first."""
    steps = tf.norm(_next(points) - points, axis=-1)
    return tf.concat([[0.0], tf.cumsum(steps)], axis=0)


def passed(travelled: tf.Tensor, count: int) -> tf.Tensor:
    """Which point [count] of a polygon with `lengths` `travelled` each of `count` evenly spaced ones follows.

    Apart from `spaced`, because compiled it would compare every point with every other.
    """
    found = tf.searchsorted(travelled, _spacing(travelled, count), side="right")
    return tf.minimum(found, tf.shape(travelled)[0] - 1) - 1


def spaced(points: tf.Tensor, travelled: tf.Tensor, before: tf.Tensor) -> tf.Tensor:
    """The evenly spaced points [count, 2] of the closed polygon `points`, each after its point `before`."""
    ring = tf.concat([points, points[:1]], axis=0)
    wanted = _spacing(travelled, before.shape[0])
    begun, step = tf.gather(travelled, before), tf.gather(travelled[1:] - travelled[:-1], before)
    fraction = tf.math.divide_no_nan(wanted - begun, step)
    start = tf.gather(ring, before)
    return start + fraction[:, None] * (tf.gather(ring, before + 1) - start)


def _spacing(travelled: tf.Tensor, count: int) -> tf.Tensor:
    return tf.range(count, dtype=tf.float32) * (travelled[-1] / count)


def segments(points: tf.Tensor) -> tf.Tensor:
    """Directed edges [..., n, 2 ends, 2] of closed polygons [..., n, 2]."""
    return tf.stack([points, _next(points)], axis=-2)


def summed(left: Deposits, size: Sides, *, layers: int = 1) -> tf.Tensor:
    """The heights left in each cell of so many layers of a picture, a vector.

    Not to be compiled: that adds them one by one.
    """
    return tf.math.unsorted_segment_sum(left.heights, left.cells, layers * _cells(size))


def accumulated(edge_heights: tf.Tensor, size: Sides, *, layers: int = 1) -> tf.Tensor:
    """Coverage float32 [layers, H, W] from the heights `summed` in the cells of each layer."""
    height, width = size
    rows, padded = height + _ROWS, _padded(width)
    sums = _running_sum(edge_heights, layers * rows, padded)
    return tf.reshape(sums, [layers, rows, padded])[:, :height, :width]


def union(coverage: tf.Tensor) -> tf.Tensor:
    """Of the `coverage` by closed loops that all turn the same way, that by their union: in [0, 1]."""
    return tf.minimum(tf.abs(coverage), 1)


def _cells(size: Sides) -> tf.Tensor | int:
    return (size[0] + _ROWS) * _padded(size[1])


def _padded(width: tf.Tensor | int) -> tf.Tensor | int:
    return (width // _BLOCK + 1) * _BLOCK


def deposits(edges: tf.Tensor, size: Sides, *, layers: tf.Tensor | int = 0) -> Deposits:
    """Where each of the `edges` [n, 2 ends, 2] leaves how much of its height.

    An edge is clipped to each of the rows that it crosses; each part is shared between the pixel that holds
    its middle and the next one so that the area left of the middle is exact. What lies above the picture has
    no height left after clipping; what lies below falls into `_ROWS` spare rows. `layers` int32 [n] are the
    edges' layers.
    """
    height, width = size
    x0, y0, x1, y1 = tf.unstack(tf.reshape(edges, [-1, 4]), axis=1)
    top = tf.clip_by_value(tf.floor(tf.minimum(y0, y1)), 0, tf.cast(height, tf.float32))
    rows = top + tf.range(_ROWS, dtype=tf.float32)[:, None]
    start, end = (tf.maximum(tf.minimum(y, rows + 1), rows) for y in (y0, y1))
    slope = tf.math.divide_no_nan(x1 - x0, y1 - y0)
    middle = x0 + slope * ((start + end) * 0.5 - y0)
    middle = tf.clip_by_value(middle, 0, tf.cast(width, tf.float32) - 1e-3)
    column = tf.floor(middle)
    rise = end - start
    beyond = rise * (middle - column)
    cell = tf.cast(rows, tf.int32) * _padded(width) + tf.cast(column, tf.int32) + layers * _cells(size)
    return Deposits(
        tf.reshape(tf.stack([cell, cell + 1]), [-1]), tf.reshape(tf.stack([rise - beyond, beyond]), [-1])
    )


def _running_sum(values: tf.Tensor, height: tf.Tensor | int, width: tf.Tensor | int) -> tf.Tensor:
    """Cumulative sums along the rows of `values` [H * W] (W a multiple of 16): [H, W].

    Sixfold faster than tf.cumsum on a CPU: a matrix product within blocks, a cumulative sum over them.
    """
    triangle = tf.constant(np.triu(np.ones((_BLOCK, _BLOCK), np.float32)))
    within = tf.reshape(tf.reshape(values, [-1, _BLOCK]) @ triangle, [height, width // _BLOCK, _BLOCK])
    before = tf.cumsum(within[:, :, -1], axis=1, exclusive=True)
    return tf.reshape(within + before[:, :, None], [height, width])
