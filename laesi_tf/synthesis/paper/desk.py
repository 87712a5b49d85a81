"""The desk beyond the sheet's edge: plain, with wood grain, or speckled like stone and cloth.

`laesi_tf.synthesis.paper.desk_kinds` has the other kinds of desk.
"""

import math
from dataclasses import dataclass
from typing import Generic

import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.noise import simple_noise
from laesi_tf.synthesis.ranges import Scalar, Value, choice, constant, interval, probability

GRAIN_NODES = 46
DESK_NAMES = ("mottled", "wood", "woven", "checked", "tiles", "text", "dark", "green", "white")
"""The kinds of desk; `laesi_tf.synthesis.paper.desk_kinds` says what they look like."""


@dataclass(frozen=True)
class DeskParams(Generic[Value]):
    """One desk; colours in HSV, lengths in mm."""

    hue: Value = interval(0.0, 0.16)
    cold: Value = probability(0.25)
    saturation: Value = interval(0.0, 0.65)
    brightness: Value = interval(0.05, 0.95)
    grain: Value = interval(0.0, 0.4)
    grain_cells: Value = interval(10, 42)
    lengthwise: Value = probability(0.6)
    """The grain runs along the image like wood grain instead of being speckled."""
    shadow: Value = interval(0.0, 0.5)
    """Darkening of the desk right beside the sheet."""
    shadow_mm: Value = interval(1.0, 8.0)
    kind: Value = choice(*DESK_NAMES)
    hue_share: Value = interval(0.0, 1.0)
    saturation_share: Value = interval(0.0, 1.0)
    brightness_share: Value = interval(0.0, 1.0)
    """Where in its kind's ranges the colour of a desk of any kind lies."""
    angle: Value = interval(-math.pi, math.pi)
    """Direction of its pattern relative to the ruling, radians."""
    pitch_mm: Value = constant(9.0)
    """Period of the widest grain of wood and of checked cloth; rows of print: 1.8 mm and a quarter of it."""
    thread_mm: Value = constant(1.2)
    board_mm: Value = constant(90.0)
    """Width of boards and tiles."""
    tile_aspect: Value = constant(1.0)
    """Length of tiles over their width."""
    joint_mm: Value = constant(1.5)
    bonded: Value = probability(0.5)
    """Rows of tiles are shifted by half a tile, as bricks are."""
    contrast: Value = constant(0.6)
    """Darkness of print, checks and joints."""


def desk_grain(desk: DeskParams[Scalar], grid: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return the grain [H, W] of the desk, about [-1, 1], from its noise `grid` [n, n]."""
    # Repeating one column along a row stretches the noise into fibres without a second kind of noise.
    fibres = tf.where(desk.lengthwise, 0.75 * grid[:, :1] + 0.25 * grid, grid)
    return simple_noise(fibres, size, cells=desk.grain_cells).values


def paint_desk(desk: DeskParams[Scalar], grain: tf.Tensor, distance_mm: tf.Tensor) -> tf.Tensor:
    """Return the colour [3, H, W] of the desk with `grain` [H, W], darker near the sheet.

    `distance_mm` [H, W] is the distance to the sheet's edge, negative off the sheet.
    """
    hue = tf.where(desk.cold, desk.hue + 0.5, desk.hue)
    colour = hsv_to_rgb(hue, desk.saturation)[:, None, None] * desk.brightness
    return colour * (shade_beside_sheet(desk, distance_mm) * (1 + desk.grain * grain))


def shade_beside_sheet(desk: DeskParams[Scalar], distance_mm: tf.Tensor) -> tf.Tensor:
    """Return the share [H, W] of the light that the sheet leaves the desk, as in `paint_desk`."""
    return 1 - desk.shadow * tf.exp(tf.minimum(distance_mm / desk.shadow_mm, 0))
