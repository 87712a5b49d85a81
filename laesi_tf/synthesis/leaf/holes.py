"""Holes in the blade."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.leaf.outline import bend_along_midrib, half_width
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.ranges import Scalar

HOLES = 3
HOLE_POINTS = 40


def hole_outlines(leaf: LeafParams[Scalar], numbers: tf.Tensor) -> tf.Tensor:
    """Return the outlines [HOLES, HOLE_POINTS, 2] mm of the leaf's holes.

    `numbers` [HOLES, 8] are uniform in [0, 1). Their orientation is opposite to that of the leaf's outline.
    An absent hole has radius zero and so no area. Each has its own stretch of the midrib and stays within the
    middle of the half-blade, so holes meet neither each other nor the edge. Bitten leaves have none: a bite
    may reach where a hole would be.
    """
    along = 0.28 + (tf.range(HOLES, dtype=tf.float32) + 0.2 + 0.6 * numbers[:, 0]) * (0.44 / HOLES)
    available = half_width(leaf, along) * (1 - leaf.lobe_depth) * 0.5 * leaf.aspect
    side = tf.where(numbers[:, 1] < 0.5, -1.0, 1.0)
    across = side * available * (0.42 + 0.16 * numbers[:, 2])
    max_radius = tf.minimum(available * 0.32, 0.4 * 0.44 / HOLES)
    radius = tf.minimum(leaf.hole_radius * (0.5 + numbers[:, 3]), max_radius)
    radius *= tf.cast(leaf.holed & ~leaf.bitten, tf.float32) * tf.cast(numbers[:, 4] < 0.6, tf.float32)
    angle = tf.constant(np.linspace(0, 2 * math.pi, HOLE_POINTS, endpoint=False), tf.float32)
    phases = 2 * math.pi * numbers[:, 5:]
    wobble = 1 + 0.15 * tf.sin(2 * angle + phases[:, :1]) + 0.08 * tf.sin(3 * angle + phases[:, 1:2])
    reach = (radius[:, None] * wobble) / 1.23
    x = (along[:, None] + reach * tf.cos(angle)) * leaf.length_mm
    y = (across[:, None] - reach * tf.sin(angle)) * leaf.length_mm
    return bend_along_midrib(leaf, x, y)
