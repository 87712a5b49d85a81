"""Holes within the blade."""

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.leaf.outline import bend_along_midrib, half_width
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.random_streams import RandomStreams, Stream

HOLES = 3
HOLE_POINTS = 40


def sample_hole_numbers(key: RandomStreams) -> tf.Tensor:
    """The numbers [HOLES, 8] in [0, 1) behind `holes`."""
    return key.uniform([HOLES, 8], Stream.HOLES)


def hole_outlines(leaf: LeafParams, place: tf.Tensor) -> tf.Tensor:
    """Outlines [HOLES, HOLE_POINTS, 2] mm of the leaf's holes at `hole_places`, turning against `outline`.

    A hole that is absent has radius zero and so no area. Each has its own stretch of the midrib and stays
    within the middle of the half-blade, so holes never meet each other or the margin. Bitten leaves have
    none: a bite may reach where a hole would be.
    """
    along = 0.28 + (tf.range(HOLES, dtype=tf.float32) + 0.2 + 0.6 * place[:, 0]) * (0.44 / HOLES)
    half_width_mm = half_width(leaf, along) * (1 - leaf.lobe_depth) * 0.5 * leaf.aspect
    side = tf.where(place[:, 1] < 0.5, -1.0, 1.0)
    across = side * half_width_mm * (0.42 + 0.16 * place[:, 2])
    room = tf.minimum(half_width_mm * 0.32, 0.4 * 0.44 / HOLES)
    radius = tf.minimum(leaf.hole_radius * (0.5 + place[:, 3]), room)
    radius *= tf.cast(leaf.holed & ~leaf.bitten, tf.float32) * tf.cast(place[:, 4] < 0.6, tf.float32)
    angle = tf.constant(np.linspace(0, 2 * np.pi, HOLE_POINTS, endpoint=False), tf.float32)
    turns = place[:, 5:] * 6.3
    wobble = 1 + 0.15 * tf.sin(2 * angle + turns[:, :1]) + 0.08 * tf.sin(3 * angle + turns[:, 1:2])
    reach = (radius[:, None] * wobble) / 1.23
    x = (along[:, None] + reach * tf.cos(angle)) * leaf.length_mm
    y = (across[:, None] - reach * tf.sin(angle)) * leaf.length_mm
    return bend_along_midrib(leaf, x, y)
