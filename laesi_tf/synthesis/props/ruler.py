"""A ruler with a scale of its own, which is not the paper's."""

from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.props.placement import UNIT_SQUARE, PropContext, PropParams, PropShape, place_parts
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability

_MARKS = 160
"""Marks of the scale, one each mm: the ruler's other end is bare."""
_MARK_MM = 0.25


@dataclass(frozen=True)
class RulerParams(PropParams[Value]):
    """A ruler."""

    ruler: Value = probability(0.0)
    ruler_mm: Value = interval(110, 310)
    ruler_width_mm: Value = interval(15, 38)
    ruler_opacity: Value = interval(0.35, 1.0)
    """Below one the ruler is clear plastic."""


def join_bars(positions: np.ndarray, lengths: np.ndarray, widths: np.ndarray | float) -> tf.Tensor:
    """Return one polygon [4 n, 2] of n bars: at `positions` [n] along x, of `lengths` [n] along y."""
    half = np.broadcast_to(np.asarray(widths) / 2, positions.shape)
    x = np.stack([positions - half, positions - half, positions + half, positions + half], axis=1)
    y = np.stack([0 * lengths, lengths, lengths, 0 * lengths], axis=1)
    return tf.constant(np.stack([x, y], axis=-1).reshape(-1, 2), tf.float32)


def make_ruler(
    ruler: RulerParams[Scalar], largest: RulerParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a ruler of wood, metal or plastic, its marks and its shadow."""
    mark = np.arange(_MARKS)
    lengths = np.where(mark % 10 == 0, 7.0, np.where(mark % 5 == 0, 5.0, 3.5))
    half_size = tf.stack([ruler.ruler_mm, ruler.ruler_width_mm]) / 2
    # The scale of a short ruler stops at its end.
    last = tf.stack([ruler.ruler_mm - 8, 10.0])
    marks = tf.minimum(join_bars(mark.astype(float), lengths, _MARK_MM), last) + tf.stack([4.0, 0.0])
    body, scale = place_parts([UNIT_SQUARE * half_size, marks - half_size], context, ruler, turn=ruler.turn)
    colour = hsv_to_rgb(0.1 + 0.05 * numbers[0], ruler.saturation * 0.5)[:, None, None] * (
        0.6 + 0.4 * numbers[1]
    )
    plate = PropShape(
        body, colour, 2.1 * (largest.ruler_mm + largest.ruler_width_mm), opacity=ruler.ruler_opacity
    )
    ink = tf.fill([3, 1, 1], 0.1 + 0.2 * numbers[2])
    return [plate.shadow(0.8), plate, PropShape(scale, ink, 2.2 * float(lengths.sum() + _MARKS))]
