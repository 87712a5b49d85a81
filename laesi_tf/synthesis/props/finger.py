"""A finger that holds the sheet."""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape, place_parts
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability

_ANGLE = np.linspace(0, 2 * math.pi, 24, endpoint=False)
_ELLIPSE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class FingerParams(PropParams[Value]):
    """A finger."""

    finger: Value = probability(0.0)
    finger_mm: Value = interval(50, 110)
    """Visible length."""
    finger_width_mm: Value = interval(12, 20)
    finger_tone: Value = interval(0.0, 1.0)
    """Of the skin, dark to light."""


def make_finger(
    finger: FingerParams[Scalar], largest: FingerParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a finger that points at the leaf, its nail and its shadow."""
    half_length, half_width = finger.finger_mm / 2, finger.finger_width_mm / 2
    # A round tip at the end of negative x, which lies beside the leaf.
    shift = tf.where(_ELLIPSE[:, 0] < 0, half_width - half_length, half_length - half_width)
    skin = _ELLIPSE * half_width * [1.0, 1.0] + tf.stack([shift, tf.zeros_like(shift)], axis=-1)
    centre = tf.stack([half_width * 1.05 - half_length, 0.0])
    nail = _ELLIPSE * half_width * [0.7, 0.55] + centre
    whole, tip = place_parts([skin, nail], context, finger, turn=finger.direction + 0.15 * finger.turn)
    dark, light = tf.constant([0.3, 0.19, 0.14]), tf.constant([0.93, 0.74, 0.63])
    colour = (dark + finger.finger_tone * (light - dark))[:, None, None]
    reach_mm = 2.2 * (largest.finger_mm + largest.finger_width_mm)
    flesh = PropShape(whole, colour, reach_mm)
    pale = tf.minimum(colour * 1.1 + 0.05 * numbers[0], 1)
    return [flesh.shadow(2.5), flesh, PropShape(tip, pale, 4 * largest.finger_width_mm, opacity=0.8)]
