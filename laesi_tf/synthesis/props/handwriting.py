"""A word written on the sheet."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import curves
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.polygons import stroke_outlines
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar

WRITING_POINTS = 48


def make_handwriting(props: PropsParams[Scalar], context: PropContext, numbers: tf.Tensor) -> list[PropShape]:
    """Return a word written on the sheet itself."""
    word = handwriting_stroke(
        numbers[:32], props.handwriting_mm, props.handwriting_mm * props.handwriting_height / 2, props
    )
    points = place_beside_leaf(word, context, props.direction + 4.0, props.turn * 0.15, props.gap_mm)
    return [PropShape(points, ink_colour(props), 320, opacity=0.85)]


def handwriting_stroke(
    numbers: tf.Tensor, length_mm: tf.Tensor, height_mm: tf.Tensor, props: PropsParams[Scalar]
) -> tf.Tensor:
    """Return the outline [2 * WRITING_POINTS, 2] mm, centred, of a word: loops of random height."""
    t = tf.constant(np.linspace(0, 1, WRITING_POINTS), tf.float32)
    letters = 8
    knots = tf.constant(curves.linear(letters + 1, WRITING_POINTS))
    loops = 2 * math.pi * letters * t
    tall = tf.linalg.matvec(knots, numbers[: letters + 1])
    lean = tf.linalg.matvec(knots, numbers[letters + 1 : 2 * letters + 2])
    x = (t - 0.5) * length_mm + height_mm * 0.7 * lean * tf.cos(loops)
    y = height_mm * (0.35 + tall) * tf.sin(loops)
    return stroke_outlines(tf.stack([x, y], -1), tf.fill([WRITING_POINTS], props.stroke_mm))


def ink_colour(props: PropsParams[Scalar]) -> tf.Tensor:
    """Return the colour [3, 1, 1] of the ink."""
    return hsv_to_rgb(props.hue * 0.3 + 0.5, props.saturation)[:, None, None] * props.ink_value
