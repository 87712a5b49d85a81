"""Shapes of props, and where they lie: beside the leaf, never on it.

Each is a unit shape moved by T_xy R_theta S_xy, in sheet mm (paper, "Scene Composition"). A prop's position
is found along a direction from the leaf: the leaf's support in that direction plus the prop's own, plus a
gap. The straight line between the two supports proves that the prop never covers the leaf.
"""

import math
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.camera.view import CameraView
from laesi_tf.synthesis.ranges import Value, interval

SHAPE_NUMBERS = 80
"""Uniform numbers that a prop's shape may use."""
UNIT_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
"""Corners [4, 2] of the square from -1 to 1."""


@dataclass(frozen=True)
class PropParams(Generic[Value]):
    """Position and colour of a prop: angles in radians, colours in HSV.

    Each prop adds its size and the probability of its presence, a field of the prop's name. Props share these
    names, hence their ranges, but each samples its own numbers.
    """

    direction: Value = interval(-math.pi, math.pi)
    gap_mm: Value = interval(2, 30)
    turn: Value = interval(-math.pi, math.pi)
    hue: Value = interval(0.0, 1.0)
    saturation: Value = interval(0.0, 0.9)


class PropContext(NamedTuple):
    """What a prop is placed in.

    The leaf's `outline` [n, 2] in sheet mm, the camera's `view` of it, and the image's width and height in
    pixels, `image_wh` [2].
    """

    outline: tf.Tensor
    view: CameraView
    image_wh: tf.Tensor


class PropShape(NamedTuple):
    """One flat shape of a prop: its polygon [n, 2] in sheet mm, colour [3, 1, 1] and opacity.

    `max_perimeter_mm` bounds its perimeter, so that it can be cut into edges of at most two pixels.
    """

    points: tf.Tensor
    colour: tf.Tensor
    max_perimeter_mm: float
    opacity: float | tf.Tensor = 1.0

    def shadow(self, thickness_mm: float) -> "PropShape":
        """Return the narrow shadow that it throws on the sheet if it is `thickness_mm` thick."""
        return PropShape(self.points + thickness_mm, tf.zeros([3, 1, 1]), self.max_perimeter_mm, 0.25)


def place_beside_leaf(
    shape: tf.Tensor, context: PropContext, direction: tf.Tensor, turn: tf.Tensor, gap_mm: tf.Tensor
) -> tf.Tensor:
    """Turn `shape` [n, 2] (mm, centred) and move it off the leaf along `direction`: sheet mm [n, 2].

    `direction` and `turn` are radians, `gap_mm` is the distance between the supports of leaf and shape.
    """
    turned = turn_points(shape, turn)
    away = tf.stack([tf.cos(direction), tf.sin(direction)])
    support = tf.reduce_max(tf.linalg.matvec(context.outline, away))
    own = -tf.reduce_min(tf.linalg.matvec(turned, away))
    return turned + away * (support + own + gap_mm)


def turn_points(points: tf.Tensor, turn: tf.Tensor) -> tf.Tensor:
    """Return `points` [n, 2] turned about the origin by `turn` radians."""
    cosine, sine = tf.cos(turn), tf.sin(turn)
    return points @ tf.stack([tf.stack([cosine, sine]), tf.stack([-sine, cosine])])


def place_parts(
    parts: list[tf.Tensor], context: PropContext, params: PropParams[Any], *, turn: tf.Tensor
) -> list[tf.Tensor]:
    """Place `parts` [n_i, 2] of one prop as `place_beside_leaf` does, so that they stay together."""
    whole = tf.concat(parts, axis=0)
    placed = place_beside_leaf(whole, context, params.direction, turn, params.gap_mm)
    return list(tf.split(placed, [part.shape[0] for part in parts]))
