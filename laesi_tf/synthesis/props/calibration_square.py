"""The red square from which rule-based methods take the scale."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import geometry
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, PropShape, place_beside_leaf, unit_square

_DIRECTIONS = 16
"""In which a place for the calibration square is looked for."""


def make_calibration_square(props: PropsParams, stage: PropContext, random: tf.Tensor) -> list[PropShape]:
    """A flat red square beside the leaf, in the direction in which most of it is seen."""
    square = unit_square() * props.calibration_mm / 2
    turns = random[0] * 2 * math.pi + np.arange(_DIRECTIONS, dtype=np.float32) * (2 * math.pi / _DIRECTIONS)
    gap_mm = props.gap_mm / 4
    places = tf.stack(
        [place_beside_leaf(square, stage, direction, props.turn, gap_mm) for direction in tf.unstack(turns)]
    )
    corners = geometry.project_points(stage.view.to_px, places)
    inside = tf.reduce_min(tf.minimum(corners, stage.frame - corners), axis=[1, 2])
    points = tf.gather(places, tf.argmax(inside))
    red = hsv_to_rgb(props.calibration_hue, props.calibration_saturation) * props.calibration_value
    return [PropShape(points, red[:, None, None], 160)]
