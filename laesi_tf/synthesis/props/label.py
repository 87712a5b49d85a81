"""A label card with two lines of writing."""

import math
from dataclasses import dataclass

import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.handwriting import InkParams, handwriting_stroke, ink_colour
from laesi_tf.synthesis.props.placement import UNIT_SQUARE, PropContext, PropShape, place_beside_leaf
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability


@dataclass(frozen=True)
class LabelParams(InkParams[Value]):
    """A label card."""

    label: Value = probability(0.2)
    label_mm: Value = interval(14, 45)
    label_aspect: Value = interval(0.3, 0.7)


def make_label(
    label: LabelParams[Scalar], largest: LabelParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a label card, nearly parallel to the ruling, its two words and its shadow."""
    height_mm = label.label_mm * label.label_aspect
    words = [
        handwriting_stroke(numbers[32 * i : 32 * i + 32], label.label_mm * 0.7, height_mm * 0.14, label)
        + tf.stack([0.0, (0.4 * i - 0.2) * height_mm])
        for i in range(2)
    ]
    card = UNIT_SQUARE * tf.stack([label.label_mm, height_mm]) / 2
    quarter_turns = tf.round(label.turn * 2 / math.pi) * (math.pi / 2)
    points = place_beside_leaf(
        tf.concat([card, *words], axis=0),
        context,
        label.direction,
        quarter_turns + 0.1 * numbers[70],
        label.gap_mm,
    )
    colour = hsv_to_rgb(label.hue, label.saturation * 0.1)[:, None, None] * 0.95
    longest_mm = largest.label_mm * max(1, largest.label_aspect / 0.7)
    writing = [PropShape(word, ink_colour(label), 5.8 * longest_mm) for word in tf.split(points[4:], 2)]
    paper = PropShape(points[:4], colour, 3.8 * longest_mm)
    return [paper.shadow(0.5), paper, *writing]
