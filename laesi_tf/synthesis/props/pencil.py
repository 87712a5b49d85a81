"""A pencil."""

from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape, place_parts
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability

_BODY = np.array([[-1, -1], [0.8, -1], [0.8, 1], [-1, 1]], np.float32)
_STRIPE = _BODY * np.array([1, 0.35], np.float32)
_CONE = np.array([[0.8, -1], [1, -0.1], [1, 0.1], [0.8, 1]], np.float32)
_LEAD = np.array([[0.95, -0.32], [1, -0.1], [1, 0.1], [0.95, 0.32]], np.float32)


@dataclass(frozen=True)
class PencilParams(PropParams[Value]):
    """A pencil."""

    pencil: Value = probability(0.0)
    pencil_mm: Value = interval(80, 180)
    """Length."""
    pencil_thickness_mm: Value = interval(6, 9)


def make_pencil(
    pencil: PencilParams[Scalar], largest: PencilParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a six-sided pencil, its sharpened wood and lead, and its shadow."""
    half_size = tf.stack([pencil.pencil_mm, pencil.pencil_thickness_mm]) / 2
    parts = [part * half_size for part in (_BODY, _STRIPE, _CONE, _LEAD)]
    body, stripe, cone, lead = place_parts(parts, context, pencil, turn=pencil.turn)
    paint = hsv_to_rgb(pencil.hue, pencil.saturation)[:, None, None] * (0.3 + 0.6 * numbers[0])
    wood, grey = tf.constant([0.82, 0.66, 0.46])[:, None, None], tf.fill([3, 1, 1], 0.15)
    reach_mm = 2.1 * (largest.pencil_mm + largest.pencil_thickness_mm)
    rod = PropShape(body, paint, reach_mm)
    return [
        rod.shadow(1.0),
        rod,
        PropShape(stripe, tf.minimum(paint * 1.35, 1), reach_mm),
        PropShape(cone, wood, reach_mm / 4),
        PropShape(lead, grey, reach_mm / 8),
    ]
