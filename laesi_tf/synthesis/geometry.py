"""Homographies, pixel grids and closed polygons in TensorFlow.

Points are (x, y) floats; pixel (row i, column j) covers [j, j+1] x [i, i+1], so pixel centres lie at halves.
A homography [3, 3] maps (X, Y, 1) on the sheet, in mm, to pixels. `laesi_tf.common.geometry` is the NumPy
twin.
"""

from typing import TypeAlias

import numpy as np
import tensorflow as tf

ImageSize: TypeAlias = tuple[int, int]
"""Height and width in pixels."""


def require_shape(name: str, tensor: tf.Tensor, shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless the static shape of `tensor` is compatible with `shape`; None is any length."""
    if not tensor.shape.is_compatible_with(shape):
        raise ValueError(f"{name} has shape {tensor.shape}; expected {list(shape)}")


def project_points(homography: tf.Tensor, points: tf.Tensor) -> tf.Tensor:
    """Map `points` [..., 2] through `homography` [3, 3]."""
    require_shape("homography", homography, (3, 3))
    flat = tf.reshape(points, [-1, 2])
    mapped = tf.linalg.matmul(flat, homography[:, :2], transpose_b=True) + homography[:, 2]
    return tf.reshape(mapped[:, :2] / mapped[:, 2:], tf.shape(points))


def px_per_mm_at(homography: tf.Tensor, point: tf.Tensor) -> tf.Tensor:
    """Return pixels per mm at `point` [2] mm: the root of the Jacobian determinant, |det H| / w^3."""
    require_shape("point", point, (2,))
    w = tf.reduce_sum(homography[2, :2] * point) + homography[2, 2]
    return tf.sqrt(tf.abs(determinant(homography)) / tf.abs(w) ** 3)


def determinant(matrix: tf.Tensor) -> tf.Tensor:
    """Return the determinant [] of `matrix` [3, 3]; XLA lacks that of TensorFlow."""
    return tf.reduce_sum(matrix[0] * tf.linalg.cross(matrix[1], matrix[2]))


def invert_homography(homography: tf.Tensor) -> tf.Tensor:
    """Return the inverse [3, 3] of a homography up to a factor, which its division removes: the adjugate."""
    columns = tf.linalg.cross(tf.gather(homography, [1, 2, 0]), tf.gather(homography, [2, 0, 1]))
    return tf.transpose(columns)


def pixel_centres_to_sheet(to_px: tf.Tensor, size: ImageSize) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the sheet positions X and Y, [H, W] mm, of all pixel centres under homography `to_px` [3, 3]."""
    # The adjugate: a homography's inverse up to a factor, which the division removes.
    inverse = tf.linalg.cross(tf.gather(to_px, [1, 2, 0]), tf.gather(to_px, [2, 0, 1]))
    u = tf.range(size[1], dtype=tf.float32)[None, :] + 0.5
    v = tf.range(size[0], dtype=tf.float32)[:, None] + 0.5
    x, y, w = (u * column[0] + (v * column[1] + column[2]) for column in tf.unstack(inverse, axis=1))
    reciprocal = 1 / w
    return x * reciprocal, y * reciprocal


def signed_area(points: tf.Tensor) -> tf.Tensor:
    """Return the shoelace area [...] of closed polygons [..., n, 2], positive if clockwise on screen."""
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
