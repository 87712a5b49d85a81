"""A word written on the sheet."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import curves, polygons
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf

WRITING_POINTS = 48


def make_handwriting(props: PropsParams, stage: PropContext, random: tf.Tensor) -> list[PropShape]:
    """A word written on the sheet itself."""
    word = handwriting_stroke(
        random[:32], props.handwriting_mm, props.handwriting_mm * props.handwriting_height / 2, props
    )
    points = place_beside_leaf(word, stage, props.direction + 4.0, props.turn * 0.15, props.gap_mm)
    return [PropShape(points, ink_colour(props), 320, opacity=0.85)]


def handwriting_stroke(
    random: tf.Tensor, length_mm: tf.Tensor, height_mm: tf.Tensor, props: PropsParams
) -> tf.Tensor:
    """A handwritten word as one ribbon [2 * WRITING_POINTS, 2] mm, centred: loops of random height."""
    t = tf.constant(np.linspace(0, 1, WRITING_POINTS), tf.float32)
    letters = 8
    knots = tf.constant(curves.linear(letters + 1, WRITING_POINTS))
    loops = 2 * math.pi * letters * t
    tall = tf.linalg.matvec(knots, random[: letters + 1])
    lean = tf.linalg.matvec(knots, random[letters + 1 : 2 * letters + 2])
    x = (t - 0.5) * length_mm + height_mm * 0.7 * lean * tf.cos(loops)
    y = height_mm * (0.35 + tall) * tf.sin(loops)
    return polygons.stroke_outlines(tf.stack([x, y], -1), tf.fill([WRITING_POINTS], props.stroke_mm))


def ink_colour(props: PropsParams) -> tf.Tensor:
    return hsv_to_rgb(props.hue * 0.3 + 0.5, props.saturation)[:, None, None] * props.ink_value
