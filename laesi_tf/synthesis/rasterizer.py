"""Exact coverage of pixels by simple polygons.

The accumulation method of font rasterizers: each short edge adds its signed height to the pixel that it
crosses, and a running sum along the row turns edges into area. The sum over the image equals the polygon's
shoelace area up to rounding, which keeps mask and label consistent. Points are (x, y) float32 in pixels,
pixel (i, j) covering [j, j+1] x [i, i+1].

Three steps, since the first and the last are compiled and the second must not be: `edge_contributions` of the
directed edges of closed loops, `sum_contributions` in each cell, and `integrate_coverage` along the rows.
Loops of the same orientation add, loops of opposite orientation cancel, so a hole is a loop of the opposite
orientation. Edges must be at most two pixels high, so that none crosses more than three rows; parts outside
of the image are clipped correctly.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.geometry import ImageSize

RasterSize: TypeAlias = ImageSize | tuple[tf.Tensor, tf.Tensor]
"""Height and width of an image, or of a window whose size is known at run time only."""
_BLOCK = 16
_ROWS = 3


class EdgeContributions(NamedTuple):
    """Flat cell indices int32 [6n] of an image, and the signed heights [6n] that edges add to these cells."""

    cells: tf.Tensor
    heights: tf.Tensor


def edge_contributions(
    edges: tf.Tensor, size: RasterSize, *, layers: tf.Tensor | int = 0
) -> EdgeContributions:
    """Return what each of `edges` [n, 2 ends, 2] contributes to which cells.

    An edge is clipped to each row that it crosses; each part is shared between the pixel at its middle and
    the next one so that the area left of the middle is exact. Parts above the image have no height left after
    clipping; those below fall into `_ROWS` spare rows. `layers` int32 [n] are the edges' layers.
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
    cell = (
        tf.cast(rows, tf.int32) * _padded_width(width)
        + tf.cast(column, tf.int32)
        + layers * _cell_count(size)
    )
    return EdgeContributions(
        tf.reshape(tf.stack([cell, cell + 1]), [-1]), tf.reshape(tf.stack([rise - beyond, beyond]), [-1])
    )


def sum_contributions(contributions: EdgeContributions, size: RasterSize, *, layers: int = 1) -> tf.Tensor:
    """Sum the contributions to each cell of `layers` layers of an image; returns a vector.

    Not to be compiled: XLA adds them one by one.
    """
    return tf.math.unsorted_segment_sum(
        contributions.heights, contributions.cells, layers * _cell_count(size)
    )


def integrate_coverage(cell_sums: tf.Tensor, size: RasterSize, *, layers: int = 1) -> tf.Tensor:
    """Return the signed coverage, float32 [layers, H, W], from the `sum_contributions` of each layer."""
    height, width = size
    rows, padded = height + _ROWS, _padded_width(width)
    sums = _running_sum(cell_sums, layers * rows, padded)
    return tf.reshape(sums, [layers, rows, padded])[:, :height, :width]


def union_coverage(coverage: tf.Tensor) -> tf.Tensor:
    """Return the coverage in [0, 1] by the union of loops of one orientation that may overlap."""
    return tf.minimum(tf.abs(coverage), 1)


def _cell_count(size: RasterSize) -> tf.Tensor | int:
    return (size[0] + _ROWS) * _padded_width(size[1])


def _padded_width(width: tf.Tensor | int) -> tf.Tensor | int:
    return (width // _BLOCK + 1) * _BLOCK


def _running_sum(values: tf.Tensor, height: tf.Tensor | int, width: tf.Tensor | int) -> tf.Tensor:
    """Return cumulative sums along the rows of `values` [H * W], W a multiple of 16: [H, W].

    Six times faster than tf.cumsum on a CPU: a matrix product within blocks, a cumulative sum over blocks.
    """
    triangle = tf.constant(np.triu(np.ones((_BLOCK, _BLOCK), np.float32)))
    within = tf.reshape(tf.reshape(values, [-1, _BLOCK]) @ triangle, [height, width // _BLOCK, _BLOCK])
    before = tf.cumsum(within[:, :, -1], axis=1, exclusive=True)
    return tf.reshape(within + before[:, :, None], [height, width])
