"""A coin-like disk."""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar, Value, constant, interval, probability


@dataclass(frozen=True)
class CoinParams(PropParams[Value]):
    """A coin."""

    coin: Value = probability(0.1)
    coin_mm: Value = interval(16, 26)
    """Diameter."""
    coin_brightness: Value = constant(1.0)
    coin_relief: Value = constant(0.0)
    """Contrast of what is embossed."""


def make_coin(
    coin: CoinParams[Scalar], largest: CoinParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a metal disk with a raised rim and an embossed figure, and its shadow."""
    angle = np.linspace(0, 2 * math.pi, 32, endpoint=False)
    circle = tf.constant(np.stack([np.cos(angle), np.sin(angle)], -1), tf.float32) * (coin.coin_mm / 2)
    points = place_beside_leaf(circle, context, coin.direction, coin.turn, coin.gap_mm)
    centre = tf.reduce_mean(points, axis=0)
    metal = tf.stack([0.62 + 0.2 * numbers[0], 0.6 + 0.15 * numbers[0], 0.55 - 0.15 * numbers[1]])
    colour, max_perimeter_mm = coin.coin_brightness * metal[:, None, None], 1.1 * math.pi * largest.coin_mm
    face = PropShape(centre + (points - centre) * 0.85, colour * 0.6, max_perimeter_mm, opacity=0.3)
    disk = PropShape(points, colour, max_perimeter_mm)
    motif = centre + (points - centre) * (0.25 + 0.5 * numbers[2:34, None])
    dark = PropShape(motif, colour * 0.4, 3 * max_perimeter_mm, opacity=coin.coin_relief)
    bright = PropShape(
        motif + 0.02 * coin.coin_mm, 0.3 + 0.7 * colour, 3 * max_perimeter_mm, opacity=coin.coin_relief
    )
    return [disk.shadow(0.7), disk, face, dark, bright]
