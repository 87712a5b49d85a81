"""A label card with two lines of writing."""

import math

import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.handwriting import handwriting_stroke, ink_colour
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf, unit_square


def make_label(props: PropsParams, stage: PropContext, random: tf.Tensor) -> list[PropShape]:
    """A label card with two lines of writing."""
    half = props.label_mm / 2 * tf.stack([1.0, props.label_aspect])
    lines = [
        handwriting_stroke(
            random[32 * i : 32 * i + 32],
            props.label_mm * 0.7,
            props.label_mm * props.label_aspect * 0.14,
            props,
        )
        + tf.stack([0.0, (0.4 * i - 0.2) * props.label_mm * props.label_aspect])
        for i in range(2)
    ]
    shapes = tf.concat([unit_square() * half, *lines], axis=0)
    direction = props.direction + 2.0
    points = place_beside_leaf(
        shapes,
        stage,
        direction,
        tf.round(props.turn * 2 / math.pi) * (math.pi / 2) + 0.1 * random[70],
        props.gap_mm,
    )
    colour = hsv_to_rgb(props.hue, props.saturation * 0.1)[:, None, None] * 0.95
    words = [PropShape(word, ink_colour(props), 260) for word in tf.split(points[4:], 2)]
    card = PropShape(points[:4], colour, 170)
    return [card.shadow(0.5), card, *words]
