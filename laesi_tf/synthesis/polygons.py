"""Closed polygons [..., n, 2] in TensorFlow: area, edges, subdivision, resampling, outlines of strokes."""

import numpy as np
import tensorflow as tf


def signed_area(points: tf.Tensor) -> tf.Tensor:
    """Return the signed area [...] of closed polygons [..., n, 2] (shoelace), positive if clockwise on
    screen."""
    x, y = tf.unstack(points, axis=-1)
    next_x, next_y = tf.unstack(_next_points(points), axis=-1)
    return 0.5 * tf.reduce_sum(x * next_y - y * next_x, axis=-1)


def polygon_centroid(points: tf.Tensor) -> tf.Tensor:
    """Return the centroid [2] of the area of a closed polygon [n, 2]."""
    middle = tf.reduce_mean(points, axis=0)
    one = points - middle
    other = _next_points(one)
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return middle + tf.linalg.matvec(one + other, cross, transpose_a=True) / (3 * tf.reduce_sum(cross))


def polygon_edges(points: tf.Tensor) -> tf.Tensor:
    """Return the directed edges [..., n, 2 ends, 2] of closed polygons [..., n, 2]."""
    return tf.stack([points, _next_points(points)], axis=-2)


def _next_points(points: tf.Tensor) -> tf.Tensor:
    """Return the successor of each point of closed polygons [..., n, 2]; tf.roll is ten times slower."""
    return tf.concat([points[..., 1:, :], points[..., :1, :]], axis=-2)


def subdivide_polygon(points: tf.Tensor, pieces: int) -> tf.Tensor:
    """Cut each edge of closed polygons [..., n, 2] into `pieces` equal ones: [..., n * pieces, 2]."""
    if pieces == 1:
        return points
    cuts = subdivide_edges(polygon_edges(points), pieces)[:, 0]
    return tf.reshape(cuts, [*points.shape[:-2], points.shape[-2] * pieces, 2])


def subdivide_edges(edges: tf.Tensor, pieces: int) -> tf.Tensor:
    """Cut edges [..., 2 ends, 2] into `pieces` equal ones: [n * pieces, 2 ends, 2]."""
    fraction = tf.constant(np.arange(pieces + 1, dtype=np.float32) / pieces)[:, None]
    start, end = tf.split(tf.reshape(edges, [-1, 2, 2]), 2, axis=1)
    cuts = start + fraction * (end - start)
    return tf.reshape(tf.stack([cuts[:, :-1], cuts[:, 1:]], axis=2), [-1, 2, 2])


def resample_polygon(points: tf.Tensor, count: int) -> tf.Tensor:
    """Return `count` points [count, 2] at equal distances along the closed polygon `points` [n, 2]."""
    lengths = cumulative_lengths(points)
    return interpolate_at(points, lengths, find_segments(lengths, count))


def cumulative_lengths(points: tf.Tensor) -> tf.Tensor:
    """Return the length [n + 1] along the closed polygon `points` [n, 2] to each point and to its end."""
    steps = tf.norm(_next_points(points) - points, axis=-1)
    return tf.concat([[0.0], tf.cumsum(steps)], axis=0)


def find_segments(lengths: tf.Tensor, count: int) -> tf.Tensor:
    """Return the edges, int32 [count], on which `count` evenly spaced points of a closed polygon lie.

    `lengths` are the polygon's `cumulative_lengths`. Apart from `interpolate_at`, since XLA would compare
    every point with every other.
    """
    found = tf.searchsorted(lengths, _even_positions(lengths, count), side="right")
    return tf.minimum(found, tf.shape(lengths)[0] - 1) - 1


def interpolate_at(points: tf.Tensor, lengths: tf.Tensor, segments: tf.Tensor) -> tf.Tensor:
    """Return the evenly spaced points [count, 2] of the closed polygon `points` [n, 2].

    `lengths` [n + 1] are its `cumulative_lengths`, `segments` [count] come from `find_segments`.
    """
    closed = tf.concat([points, points[:1]], axis=0)
    wanted = _even_positions(lengths, segments.shape[0])
    begun, step = tf.gather(lengths, segments), tf.gather(lengths[1:] - lengths[:-1], segments)
    fraction = tf.math.divide_no_nan(wanted - begun, step)
    start = tf.gather(closed, segments)
    return start + fraction[:, None] * (tf.gather(closed, segments + 1) - start)


def _even_positions(lengths: tf.Tensor, count: int) -> tf.Tensor:
    return tf.range(count, dtype=tf.float32) * (lengths[-1] / count)


def stroke_outlines(paths: tf.Tensor, widths: tf.Tensor) -> tf.Tensor:
    """Return the outlines [..., 2n, 2] of strokes of `widths` [..., n] along `paths` [..., n, 2]."""
    step = paths[..., 1:, :] - paths[..., :-1, :]
    step = tf.concat([step, step[..., -1:, :]], axis=-2)
    normal = tf.stack([-step[..., 1], step[..., 0]], axis=-1)
    normal = normal / (tf.norm(normal, axis=-1, keepdims=True) + 1e-6)
    half = normal * widths[..., None] / 2
    return tf.concat([paths + half, tf.reverse(paths - half, [-2])], axis=-2)
