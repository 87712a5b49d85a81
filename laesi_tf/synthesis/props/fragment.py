"""A torn scrap of paper."""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability


@dataclass(frozen=True)
class FragmentParams(PropParams[Value]):
    """A scrap of paper."""

    fragment: Value = probability(0.16)
    fragment_mm: Value = interval(8, 40)
    fragment_aspect: Value = interval(0.4, 1.0)


def make_fragment(
    fragment: FragmentParams[Scalar],
    largest: FragmentParams[float],
    context: PropContext,
    numbers: tf.Tensor,
) -> list[PropShape]:
    """Return a scrap of paper with ragged edges, and its shadow."""
    angle = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    reach = 1 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    square = tf.constant(np.stack([np.cos(angle), np.sin(angle)], -1) * reach[:, None], tf.float32)
    ragged = square * (0.85 + 0.15 * numbers[:16, None])
    half_size = fragment.fragment_mm / 2 * tf.stack([1.0, fragment.fragment_aspect])
    points = place_beside_leaf(
        ragged * half_size, context, fragment.direction, fragment.turn, fragment.gap_mm
    )
    colour = hsv_to_rgb(fragment.hue, fragment.saturation * 0.15)[:, None, None] * (0.8 + 0.18 * numbers[20])
    scrap = PropShape(points, colour, 4.5 * largest.fragment_mm * max(1, largest.fragment_aspect))
    return [scrap.shadow(0.5), scrap]
