"""Homographies and pixel grids in TensorFlow.

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


def require_image_size(size: ImageSize) -> None:
    """Raise ValueError unless `size` is a pair of positive whole numbers."""
    if len(size) != 2 or not all(isinstance(side, int | np.integer) and side > 0 for side in size):
        raise ValueError(f"size is {size!r}; expected (height, width), both positive whole numbers of pixels")


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
    determinant = tf.reduce_sum(homography[0] * tf.linalg.cross(homography[1], homography[2]))
    return tf.sqrt(tf.abs(determinant) / tf.abs(w) ** 3)


def pixel_centres_to_sheet(to_px: tf.Tensor, size: ImageSize) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the sheet positions X and Y, [H, W] mm, of all pixel centres under homography `to_px` [3, 3]."""
    # The adjugate: a homography's inverse up to a factor, which the division removes.
    inverse = tf.linalg.cross(tf.gather(to_px, [1, 2, 0]), tf.gather(to_px, [2, 0, 1]))
    u = tf.range(size[1], dtype=tf.float32)[None, :] + 0.5
    v = tf.range(size[0], dtype=tf.float32)[:, None] + 0.5
    x, y, w = (u * column[0] + (v * column[1] + column[2]) for column in tf.unstack(inverse, axis=1))
    reciprocal = 1 / w
    return x * reciprocal, y * reciprocal
