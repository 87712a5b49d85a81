"""A pen."""

from dataclasses import dataclass

import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability


@dataclass(frozen=True)
class PenParams(PropParams[Value]):
    """A pen."""

    pen: Value = probability(0.1)
    pen_mm: Value = interval(70, 150)
    """Length."""
    pen_thickness_mm: Value = interval(6, 12)


def make_pen(
    pen: PenParams[Scalar], largest: PenParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a tapered rod, bright along its back, and its shadow."""
    profile = tf.constant(
        [[-1, -1], [0.75, -1], [0.97, -0.25], [1, 0], [0.97, 0.25], [0.75, 1], [-1, 1]], tf.float32
    )
    half_size = tf.stack([pen.pen_mm, pen.pen_thickness_mm]) / 2
    points, back = (
        place_beside_leaf(shape, context, pen.direction, pen.turn, pen.gap_mm)
        for shape in (profile * half_size, profile * half_size * [0.94, 0.22])
    )
    back += (points[0] + points[6]) / 2 - (back[0] + back[6]) / 2
    colour = hsv_to_rgb(pen.hue, pen.saturation)[:, None, None] * (0.1 + 0.7 * numbers[0])
    max_perimeter_mm = 2.1 * (largest.pen_mm + largest.pen_thickness_mm)
    highlight = PropShape(back, tf.ones([3, 1, 1]), max_perimeter_mm, opacity=0.35)
    rod = PropShape(points, colour, max_perimeter_mm)
    return [rod.shadow(1.0), rod, highlight]
