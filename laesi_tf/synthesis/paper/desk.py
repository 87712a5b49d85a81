"""The desk beyond the sheet's edge: plain, with wood grain, or speckled like stone and cloth."""

from dataclasses import dataclass

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Number, Probability

_NODES = 46


@dataclass(frozen=True)
class DeskParams:
    """One table top; colours in HSV, lengths in mm."""

    hue: Number = (0.0, 0.16)
    cold: Number = Probability(0.25)
    saturation: Number = (0.0, 0.65)
    brightness: Number = (0.05, 0.95)
    grain: Number = (0.0, 0.4)
    grain_cells: Number = (10, 42)
    lengthwise: Number = Probability(0.6)
    """The grain runs along the picture like wood instead of being speckled."""
    shadow: Number = (0.0, 0.5)
    """Darkening of the desk right beside the sheet."""
    shadow_mm: Number = (1.0, 8.0)


def sample_desk_noise_grid(key: RandomStreams) -> tf.Tensor:
    """The uniform numbers [n, n] behind a table top's `grain`."""
    return key.uniform([_NODES, _NODES], Stream.DESK)


def desk_grain(top: DeskParams, lattice: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Grain [H, W] of the table top, about [-1, 1], from its `lattice`."""
    # Repeating one column along a row stretches the noise into fibres without a second kind of noise.
    fibres = tf.where(top.lengthwise, 0.75 * lattice[:, :1] + 0.25 * lattice, lattice)
    return noise.simple_noise(fibres, size, cells=top.grain_cells).field


def paint_desk(top: DeskParams, grained: tf.Tensor, distance_mm: tf.Tensor) -> tf.Tensor:
    """Colour [3, H, W] of the table top, darker near the sheet (`distance_mm` [H, W], negative off it).

    `grained` [H, W] is its `grain`.
    """
    hue = tf.where(top.cold, top.hue + 0.5, top.hue)
    colour = hsv_to_rgb(hue, top.saturation)[:, None, None] * top.brightness
    shade = 1 - top.shadow * tf.exp(tf.minimum(distance_mm / top.shadow_mm, 0))
    return colour * (shade * (1 + top.grain * grained))
