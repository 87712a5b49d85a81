"""A label card with two lines of writing."""

import math

import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.handwriting import handwriting_stroke, ink_colour
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf, unit_square
from laesi_tf.synthesis.ranges import Scalar


def make_label(props: PropsParams[Scalar], context: PropContext, numbers: tf.Tensor) -> list[PropShape]:
    """Return a label card, nearly parallel to the ruling, its two words and its shadow."""
    half_size = props.label_mm / 2 * tf.stack([1.0, props.label_aspect])
    lines = [
        handwriting_stroke(
            numbers[32 * i : 32 * i + 32],
            props.label_mm * 0.7,
            props.label_mm * props.label_aspect * 0.14,
            props,
        )
        + tf.stack([0.0, (0.4 * i - 0.2) * props.label_mm * props.label_aspect])
        for i in range(2)
    ]
    shapes = tf.concat([unit_square() * half_size, *lines], axis=0)
    quarter_turns = tf.round(props.turn * 2 / math.pi) * (math.pi / 2)
    points = place_beside_leaf(
        shapes, context, props.direction + 2.0, quarter_turns + 0.1 * numbers[70], props.gap_mm
    )
    colour = hsv_to_rgb(props.hue, props.saturation * 0.1)[:, None, None] * 0.95
    words = [PropShape(word, ink_colour(props), 260) for word in tf.split(points[4:], 2)]
    card = PropShape(points[:4], colour, 170)
    return [card.shadow(0.5), card, *words]
