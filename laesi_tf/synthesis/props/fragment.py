"""A torn scrap of paper."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar


def make_fragment(props: PropsParams[Scalar], context: PropContext, numbers: tf.Tensor) -> list[PropShape]:
    """Return a scrap of paper with ragged edges, and its shadow."""
    angle = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    reach = 1 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    square = tf.constant(np.stack([np.cos(angle), np.sin(angle)], -1) * reach[:, None], tf.float32)
    ragged = square * (0.85 + 0.15 * numbers[:16, None])
    half_size = props.fragment_mm / 2 * tf.stack([1.0, props.fragment_aspect])
    points = place_beside_leaf(ragged * half_size, context, props.direction, props.turn, props.gap_mm)
    colour = hsv_to_rgb(props.hue, props.saturation * 0.15)[:, None, None] * (0.8 + 0.18 * numbers[20])
    scrap = PropShape(points, colour, 180)
    return [scrap.shadow(0.5), scrap]
