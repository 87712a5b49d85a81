"""A pen."""

import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar


def make_pen(props: PropsParams[Scalar], context: PropContext, numbers: tf.Tensor) -> list[PropShape]:
    """Return a tapered rod, bright along its back, and its shadow."""
    profile = tf.constant(
        [[-1, -1], [0.75, -1], [0.97, -0.25], [1, 0], [0.97, 0.25], [0.75, 1], [-1, 1]], tf.float32
    )
    half_size = tf.stack([props.pen_mm, props.pen_thickness_mm]) / 2
    points, back = (
        place_beside_leaf(shape, context, props.direction + 1.0, props.turn, props.gap_mm)
        for shape in (profile * half_size, profile * half_size * [0.94, 0.22])
    )
    back += (points[0] + points[6]) / 2 - (back[0] + back[6]) / 2
    colour = hsv_to_rgb(props.hue, props.saturation)[:, None, None] * (0.1 + 0.7 * numbers[0])
    highlight = PropShape(back, tf.ones([3, 1, 1]), 340, opacity=0.35)
    rod = PropShape(points, colour, 340)
    return [rod.shadow(1.0), rod, highlight]
