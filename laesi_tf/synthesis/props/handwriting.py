"""A word written on the sheet."""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import curves
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import stroke_outlines
from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability

WRITING_POINTS = 48
_LETTERS = 8
_LETTER_BASIS = curves.linear(_LETTERS + 1, WRITING_POINTS)


@dataclass(frozen=True)
class InkParams(PropParams[Value]):
    """Ink of handwriting."""

    ink_value: Value = interval(0.05, 0.4)
    """Brightness of the ink, the V of HSV."""
    stroke_mm: Value = interval(0.3, 0.9)
    """Width of a stroke."""


@dataclass(frozen=True)
class HandwritingParams(InkParams[Value]):
    """A handwritten word."""

    handwriting: Value = probability(0.25)
    handwriting_mm: Value = interval(8, 34)
    """Length of the word."""
    handwriting_height: Value = interval(0.12, 0.4)
    """Height over length."""


def make_handwriting(
    writing: HandwritingParams[Scalar],
    largest: HandwritingParams[float],
    context: PropContext,
    numbers: tf.Tensor,
) -> list[PropShape]:
    """Return a word written on the sheet itself."""
    colour = ink_colour(writing)
    height_mm = writing.handwriting_mm * writing.handwriting_height / 2
    word = handwriting_stroke(numbers[:32], writing.handwriting_mm, height_mm, writing)
    points = place_beside_leaf(word, context, writing.direction, writing.turn * 0.15, writing.gap_mm)
    max_perimeter_mm = 9.5 * largest.handwriting_mm * max(1, 2.5 * largest.handwriting_height)
    return [PropShape(points, colour, max_perimeter_mm, opacity=0.85)]


def handwriting_stroke(
    numbers: tf.Tensor, length_mm: tf.Tensor, height_mm: tf.Tensor, ink: InkParams[Scalar]
) -> tf.Tensor:
    """Return the outline [2 * WRITING_POINTS, 2] mm, centred, of a word: loops of random height."""
    t = tf.constant(np.linspace(0, 1, WRITING_POINTS), tf.float32)
    loops = 2 * math.pi * _LETTERS * t
    tall = tf.linalg.matvec(_LETTER_BASIS, numbers[: _LETTERS + 1])
    lean = tf.linalg.matvec(_LETTER_BASIS, numbers[_LETTERS + 1 : 2 * _LETTERS + 2])
    x = (t - 0.5) * length_mm + height_mm * 0.7 * lean * tf.cos(loops)
    y = height_mm * (0.35 + tall) * tf.sin(loops)
    return stroke_outlines(tf.stack([x, y], -1), tf.fill([WRITING_POINTS], ink.stroke_mm))


def ink_colour(ink: InkParams[Scalar]) -> tf.Tensor:
    """Return the colour [3, 1, 1] of the ink, blue to purple."""
    return hsv_to_rgb(ink.hue * 0.3 + 0.5, ink.saturation)[:, None, None] * ink.ink_value
