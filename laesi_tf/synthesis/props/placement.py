"""Shapes of props, and where they lie: beside the leaf, never on it.

Each is a unit shape moved by T_xy R_theta S_xy, in sheet millimetres (paper, "Scene Composition"). A prop's
position is found along a direction from the leaf: the leaf's support in that direction plus the prop's own,
plus a gap, so the straight line between them proves that it never covers the leaf.
"""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis.camera import view
from laesi_tf.synthesis.geometry import ImageSize


class PropContext(NamedTuple):
    """Where props are placed: the leaf's outline [n, 2] (sheet mm), the view and the picture's size.

    Where a stage is compiled for, `size` bounds the picture's and `frame` [2] is its width and height.
    """

    leaf: tf.Tensor
    view: view.CameraView
    size: ImageSize
    frame: tf.Tensor | None = None


def place_beside_leaf(
    shape: tf.Tensor, stage: PropContext, direction: tf.Tensor, turn: tf.Tensor, gap_mm: tf.Tensor
) -> tf.Tensor:
    """Turn `shape` [n, 2] (mm, centred) and push it off the leaf along `direction`: sheet mm [n, 2]."""
    cosine, sine = tf.cos(turn), tf.sin(turn)
    turned = shape @ tf.stack([tf.stack([cosine, sine]), tf.stack([-sine, cosine])])
    away = tf.stack([tf.cos(direction), tf.sin(direction)])
    support = tf.reduce_max(tf.linalg.matvec(stage.leaf, away))
    own = -tf.reduce_min(tf.linalg.matvec(turned, away))
    return turned + away * (support + own + gap_mm)


class PropShape(NamedTuple):
    """One flat shape of a prop: its polygon [n, 2] in sheet mm, colour [3, 1, 1] and opacity.

    `perimeter_mm` bounds its length around: the number of points it is filled with.
    """

    points: tf.Tensor
    colour: tf.Tensor
    perimeter_mm: float
    opacity: float = 1.0

    def shadow(self, thickness_mm: float) -> "PropShape":
        """The narrow shadow that it throws on the sheet when it is `thickness_mm` thick."""
        return PropShape(self.points + thickness_mm, tf.zeros([3, 1, 1]), self.perimeter_mm, 0.25)


def unit_square() -> tf.Tensor:
    return tf.constant([[-1, -1], [1, -1], [1, 1], [-1, 1]], tf.float32)
