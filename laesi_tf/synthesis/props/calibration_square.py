"""The red square from which rule-based methods take the scale."""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.placement import (
    UNIT_SQUARE,
    PropContext,
    PropParams,
    PropShape,
    place_beside_leaf,
)
from laesi_tf.synthesis.ranges import Scalar, Value, constant, interval, probability

_DIRECTIONS = 16
"""Directions from the leaf among which a position is chosen."""


@dataclass(frozen=True)
class CalibrationParams(PropParams[Value]):
    """A flat red square, present only where ranges ask for it."""

    calibration: Value = probability(0.0)
    calibration_mm: Value = constant(20.0)
    """Side: 4 cm2, as Easy Leaf Area expects it, and the same in all images."""
    calibration_hue: Value = interval(-0.02, 0.02)
    calibration_saturation: Value = interval(0.75, 0.95)
    calibration_value: Value = interval(0.65, 0.9)


def make_calibration_square(
    square: CalibrationParams[Scalar],
    largest: CalibrationParams[float],
    context: PropContext,
    numbers: tf.Tensor,
) -> list[PropShape]:
    """Return a flat red square beside the leaf, in the direction in which most of it is within the image."""
    corners = UNIT_SQUARE * square.calibration_mm / 2
    fractions = np.arange(_DIRECTIONS, dtype=np.float32) * (2 * math.pi / _DIRECTIONS)
    directions = tf.unstack(numbers[0] * 2 * math.pi + fractions)
    candidates = tf.stack(
        [
            place_beside_leaf(corners, context, direction, square.turn, square.gap_mm / 4)
            for direction in directions
        ]
    )
    pixels = context.view.to_photo(candidates)
    inside_px = tf.reduce_min(tf.minimum(pixels, context.image_wh - pixels), axis=[1, 2])
    points = tf.gather(candidates, tf.argmax(inside_px))
    red = hsv_to_rgb(square.calibration_hue, square.calibration_saturation) * square.calibration_value
    return [PropShape(points, red[:, None, None], 8 * largest.calibration_mm)]
