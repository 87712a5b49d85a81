"""A coin-like disk."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar


def make_coin(props: PropsParams[Scalar], context: PropContext, numbers: tf.Tensor) -> list[PropShape]:
    """Return a metal disk with a raised rim, and its shadow."""
    angle = np.linspace(0, 2 * math.pi, 32, endpoint=False)
    circle = tf.constant(np.stack([np.cos(angle), np.sin(angle)], -1), tf.float32) * (props.coin_mm / 2)
    points = place_beside_leaf(circle, context, props.direction + 3.0, props.turn, props.gap_mm)
    centre = tf.reduce_mean(points, axis=0)
    metal = tf.stack([0.62 + 0.2 * numbers[0], 0.6 + 0.15 * numbers[0], 0.55 - 0.15 * numbers[1]])[
        :, None, None
    ]
    face = PropShape(centre + (points - centre) * 0.85, metal * 0.6, 90, opacity=0.3)
    disk = PropShape(points, metal, 90)
    return [disk.shadow(0.7), disk, face]
