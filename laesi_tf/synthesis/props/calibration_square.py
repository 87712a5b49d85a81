"""The red square from which rule-based methods take the scale."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import project_points
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf, unit_square
from laesi_tf.synthesis.ranges import Scalar

_DIRECTIONS = 16
"""Directions from the leaf among which a position is chosen."""


def make_calibration_square(
    props: PropsParams[Scalar], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a flat red square beside the leaf, in the direction in which most of it is within the image."""
    square = unit_square() * props.calibration_mm / 2
    fractions = np.arange(_DIRECTIONS, dtype=np.float32) * (2 * math.pi / _DIRECTIONS)
    directions = tf.unstack(numbers[0] * 2 * math.pi + fractions)
    gap_mm = props.gap_mm / 4
    candidates = tf.stack(
        [place_beside_leaf(square, context, direction, props.turn, gap_mm) for direction in directions]
    )
    corners = project_points(context.to_px, candidates)
    inside_px = tf.reduce_min(tf.minimum(corners, context.image_wh - corners), axis=[1, 2])
    points = tf.gather(candidates, tf.argmax(inside_px))
    red = hsv_to_rgb(props.calibration_hue, props.calibration_saturation) * props.calibration_value
    return [PropShape(points, red[:, None, None], 160)]
