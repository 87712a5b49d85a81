"""A paper clip."""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import stroke_outlines
from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape, place_parts
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability


@dataclass(frozen=True)
class ClipParams(PropParams[Value]):
    """A paper clip."""

    clip: Value = probability(0.0)
    clip_mm: Value = interval(24, 50)
    """Length."""
    clip_wire_mm: Value = interval(0.8, 1.4)
    clip_coloured: Value = probability(0.4)


def _wire() -> np.ndarray:
    """Return the path [n, 2] of a clip of length 1: three half turns between straight parts."""

    def half_turn(x: float, y: float, radius: float, start: float) -> np.ndarray:
        angle = start + np.linspace(0, math.pi, 12)
        return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1)

    return np.concatenate(
        [
            [[-0.2, 0.1]],
            half_turn(0.34, 0.0, 0.1, -math.pi / 2)[::-1],
            half_turn(-0.36, 0.02, 0.12, math.pi / 2),
            half_turn(0.36, 0.0, 0.14, -math.pi / 2),
            [[-0.3, 0.14]],
        ]
    )


_WIRE = _wire().astype(np.float32)


def make_clip(
    clip: ClipParams[Scalar], largest: ClipParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a bent wire, of metal or coloured, and its shadow."""
    outline = stroke_outlines(_WIRE * clip.clip_mm, tf.fill([_WIRE.shape[0]], clip.clip_wire_mm))
    (points,) = place_parts([outline], context, clip, turn=clip.turn)
    metal = tf.fill([3, 1, 1], 0.45 + 0.35 * numbers[0])
    paint = hsv_to_rgb(clip.hue, clip.saturation)[:, None, None] * (0.4 + 0.5 * numbers[0])
    wire = PropShape(points, tf.where(clip.clip_coloured, paint, metal), 8 * largest.clip_mm)
    return [wire.shadow(0.5), wire]
