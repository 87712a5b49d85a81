"""The leaf's mesh, whose triangles give the label (paper, "Data Preparation")."""

import tensorflow as tf

from laesi_tf.synthesis.geometry import signed_area


def leaf_area_cm2(points: tf.Tensor, hole_points: tf.Tensor) -> tf.Tensor:
    """Return the label: summed area of the mesh triangles less the holes, cm2 (paper, "Data Preparation").

    `points` [n, 2] and `hole_points` [k, m, 2] are in mm.
    """
    blade = tf.abs(tf.reduce_sum(signed_area(outline_triangles(points))))
    return (blade - tf.reduce_sum(tf.abs(signed_area(hole_points)))) / 100


def outline_triangles(points: tf.Tensor) -> tf.Tensor:
    """Return the triangles [n - 2, 3, 2] of an outline [n, 2]: a strip between its left and right side."""
    half = points.shape[0] // 2
    left, right = points[:half], points[half:][::-1]
    near = tf.stack([left[:-1], left[1:], right[:-1]], axis=1)
    far = tf.stack([left[1:], right[1:], right[:-1]], axis=1)
    return tf.concat([near, far], axis=0)
