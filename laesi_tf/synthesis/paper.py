"""Millimetre paper (paper, section 3.1): ruling, ink, sheet, print and wear.

The ruling is C(x) = A sin(Bx + phi) + D for both axes and the 1, 5 and 10 mm families. A printed line is
sharper than one sine, so each family sums the sines of a line's Fourier series; each sine is attenuated by
the pixel's footprint, so a grid finer than two pixels per line fades to its mean instead of aliasing. With
line widths near half the pitch only the first sine is left, which is the paper's own formula.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.frame import Size
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.ranges import Chance, Number

PERIOD_MM = 10
_PITCHES = (1, 5, 10)
_HARMONICS = (8, 32, 48)
_FREQUENCY = np.concatenate(
    [np.arange(1, n + 1) / pitch for n, pitch in zip(_HARMONICS, _PITCHES, strict=True)]
)
"""Spatial frequencies B / 2 pi of all sines, cycles per mm, family after family."""
_MEMBERSHIP = np.repeat(np.eye(len(_PITCHES), dtype=np.float32), _HARMONICS, axis=1)
_UNIT = 2**16 - 1
_GRADIENT_NODES = 16
_SIMPLE_NODES = 30


@dataclass(frozen=True)
class Paper:
    """One sheet. Strengths are absorbances in [0, 1] at a line's centre, hues turns of the colour wheel."""

    hue: Number = (0.0, 1.0)
    tinted: Number = Chance(0.5)
    saturation: Number = (0.0, 0.25)
    brightness: Number = (0.8, 1.0)
    ink_hue: Number = (0.0, 1.0)
    ink_matches: Number = Chance(0.65)
    """The ink has the sheet's own hue, as on most tinted paper."""
    ink_saturation: Number = (0.25, 1.0)
    ink_darkness: Number = (0.2, 0.75)
    heavy_shift: Number = (-0.06, 0.06)
    """Hue of the 5 and 10 mm lines against the 1 mm lines."""
    heavy_darkness: Number = (0.8, 1.4)
    strength_1mm: Number = (0.35, 1.0)
    strength_5mm: Number = (0.1, 1.0)
    strength_10mm: Number = (0.2, 1.0)
    has_5mm: Number = Chance(0.72)
    has_10mm: Number = Chance(0.72)
    balance: Number = (0.75, 1.25)
    """Strength of the lines along y against those along x."""
    width_1mm: Number = (0.08, 0.3)
    width_5mm: Number = (0.12, 0.4)
    width_10mm: Number = (0.14, 0.55)
    ink_spread_mm: Number = (0.02, 0.12)
    """Standard deviation of the ink's edge: a large value leaves the paper's single sine."""
    phase_x: Number = (0.0, 10.0)
    phase_y: Number = (0.0, 10.0)
    gradient_weight: Number = (0.0, 0.05)
    gradient_cells: Number = (3, 14)
    voronoi_weight: Number = (0.0, 0.03)
    voronoi_cells: Number = (3, 8)
    simple_weight: Number = (0.0, 0.035)
    simple_cells: Number = (8, 26)
    print_wear: Number = (0.0, 0.5)
    """How far the ink's strength varies over the sheet."""
    creased: Number = Chance(0.18)
    crease_depth: Number = (0.03, 0.14)
    crease_angle: Number = (-math.pi, math.pi)
    crease_offset: Number = (-0.4, 0.4)
    """Distance of the crease from the picture's centre, in fields of view."""
    edged: Number = Chance(0.42)
    """The sheet ends within or near the frame."""
    left: Number = (2, 150)
    right: Number = (2, 150)
    top: Number = (2, 150)
    bottom: Number = (2, 150)
    """Room between the leaf's extent and each side of the sheet, mm."""
    border_mm: Number = (-6, 10)
    """Unprinted border; below zero the printing runs off the sheet."""


def samples_per_mm(size: Size) -> int:
    """Resolution of the ruling's profiles: four samples a pixel at the closest view (70 mm across)."""
    return max(10, math.ceil(4 * max(size) / 70))


def line_profiles(paper: Paper, samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Ink coverage of the 1, 5 and 10 mm families over one period: [3, PERIOD_MM * samples] in [0, 1].

    A sum of A_k sin(B_k x + phi) + D; A_k is the Fourier coefficient of a line of its width, times the
    attenuation by ink spread (Gaussian) and by the pixel (sinc^2, the triangle filter that an antialiased
    bilinear resize applies to photographs).
    """
    position = (np.arange(PERIOD_MM * samples) + 0.5) / samples
    sines = tf.constant(np.sin(2 * np.pi * _FREQUENCY[:, None] * position + np.pi / 2), tf.float32)
    widths = tf.stack([paper.width_1mm, paper.width_5mm, paper.width_10mm])
    share = widths / tf.constant(_PITCHES, tf.float32)
    frequency = tf.constant(_FREQUENCY, tf.float32)
    amplitude = (
        tf.exp(-2 * (math.pi * paper.ink_spread_mm * frequency) ** 2) * _sinc(frequency * footprint_mm) ** 2
    )
    coefficients = 2 * share[:, None] * _sinc(widths[:, None] * frequency) * amplitude
    return tf.clip_by_value((coefficients * tf.constant(_MEMBERSHIP)) @ sines + share[:, None], 0, 1)


def transmission(paper: Paper, samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Light that passes fine and heavy lines across x and down y over one period: int32 [2, n].

    A ruling is a product of lines along either axis, so two profiles hold all of it. Each number holds that
    of the fine lines in its upper and that of the heavy lines in its lower 16 bits, in 65535ths: `ruling`
    looks a pair up at once, since looking up costs more than all else that it does.
    """
    profiles = line_profiles(paper, samples, footprint_mm)
    # Without a heavy family the sheet would be a plain 1 mm grid, which is not sold: keep one of the two.
    has_10mm = tf.cast(paper.has_10mm | ~paper.has_5mm, tf.float32)
    strength_5mm = paper.strength_5mm * tf.cast(paper.has_5mm, tf.float32)
    strengths = tf.stack([paper.strength_1mm, strength_5mm, paper.strength_10mm * has_10mm])[:, None]
    across, down = 1 - profiles * strengths, 1 - profiles * tf.minimum(strengths * paper.balance, 1)
    fine = tf.stack([across[0], down[0]])
    heavy = tf.stack([across[1] * across[2], down[1] * down[2]])
    whole = tf.cast(tf.stack([fine, heavy]) * _UNIT + 0.5, tf.int32)
    return tf.bitwise.bitwise_or(tf.bitwise.left_shift(whole[0], 16), whole[1])


def places(paper: Paper, samples: int, x_mm: tf.Tensor, y_mm: tf.Tensor) -> tf.Tensor:
    """Which number of either profile of `transmission` lies at `x_mm`, `y_mm` [H, W]: int32 [2, H, W]."""
    cells = PERIOD_MM * samples
    return tf.stack([_cell(x_mm + paper.phase_x, cells), _cell(y_mm + paper.phase_y, cells)])


def ruling(passing: tf.Tensor, where: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Coverage [H, W] by fine and by heavy lines of a sheet with `transmission` `passing` at its `places`."""
    (fine_x, heavy_x), (fine_y, heavy_y) = (
        _parted(tf.gather(passing[axis], where[axis])) for axis in range(2)
    )
    return 1 - fine_x * fine_y, 1 - heavy_x * heavy_y


def _parted(pair: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """The two numbers in [0, 1] that each int32 of `pair` holds."""
    upper = tf.bitwise.bitwise_and(tf.bitwise.right_shift(pair, 16), _UNIT)
    return tuple(tf.cast(half, tf.float32) / _UNIT for half in (upper, tf.bitwise.bitwise_and(pair, _UNIT)))


def absorbed(paper: Paper, fine: tf.Tensor, heavy: tf.Tensor) -> tf.Tensor:
    """What the inks of the fine and the heavy lines [H, W] take from red, green and blue: [3, H, W]."""
    fine_ink, heavy_ink = ink_absorbances(paper)
    return 1 - (1 - fine * fine_ink) * (1 - heavy * heavy_ink)


def colour(paper: Paper) -> tf.Tensor:
    """Base colour of the sheet [3, 1, 1] in [0, 1]."""
    saturation = paper.saturation * tf.cast(paper.tinted, tf.float32) + 0.02
    return tint(paper.hue, saturation)[:, None, None] * paper.brightness


class Lattices(NamedTuple):
    """Uniform numbers behind a sheet's wear: `gradients`, `values` (of the blend, of the ink) and Voronoi
    `jitter`, each [2, n, n]."""

    gradients: tf.Tensor
    values: tf.Tensor
    jitter: tf.Tensor


def lattices(key: Key) -> Lattices:
    """The numbers of one sheet's `wear`."""
    return Lattices(
        gradients=key.uniform([2, _GRADIENT_NODES, _GRADIENT_NODES], Purpose.PAPER_GRADIENT),
        values=key.uniform([2, _SIMPLE_NODES, _SIMPLE_NODES], Purpose.PAPER),
        jitter=key.uniform([2, noise.VORONOI_CELLS + 2, noise.VORONOI_CELLS + 2], Purpose.PAPER_VORONOI),
    )


def wear(paper: Paper, drawn: Lattices, size: Size) -> tuple[tf.Tensor, tf.Tensor]:
    """The blended noise L of the paper's section 3.1, and the ink's relative strength: both [H, W]."""
    fields = (
        noise.gradient(drawn.gradients * 2 - 1, size, cells=paper.gradient_cells),
        noise.voronoi(drawn.jitter, size, cells=paper.voronoi_cells),
        noise.simple(drawn.values[0], size, cells=paper.simple_cells),
    )
    weights = (paper.gradient_weight, paper.voronoi_weight, paper.simple_weight)
    strength = noise.upsample(drawn.values[1], size, cells=paper.simple_cells)
    return noise.blend(weights, fields).field, 1 - paper.print_wear * strength.field


def crease(paper: Paper, x_mm: tf.Tensor, y_mm: tf.Tensor, fov_mm: tf.Tensor) -> tf.Tensor:
    """Relief shading [H, W] of a fold across the sheet: one flank lit, the other in shade."""
    cosine, sine = tf.cos(paper.crease_angle), tf.sin(paper.crease_angle)
    distance = (x_mm * cosine + (y_mm * sine - paper.crease_offset * fov_mm)) / 1.2
    return paper.crease_depth * 2 * distance * tf.exp(-distance * distance)


def margin(paper: Paper, leaf: tf.Tensor, x_mm: tf.Tensor, y_mm: tf.Tensor) -> tf.Tensor:
    """Distance [H, W] in mm from the nearest side of the sheet that holds `leaf` [n, 2]; negative off it."""
    low = tf.reduce_min(leaf, axis=0) - tf.stack([paper.left, paper.top])
    high = tf.reduce_max(leaf, axis=0) + tf.stack([paper.right, paper.bottom])
    middle, half = (low + high) / 2, (high - low) / 2
    return tf.minimum(half[0] - tf.abs(x_mm - middle[0]), half[1] - tf.abs(y_mm - middle[1]))


def tint(hue: tf.Tensor, saturation: tf.Tensor) -> tf.Tensor:
    """Colour of full value [3] (HSV) at `hue` in turns and `saturation` in [0, 1]."""
    wheel = tf.constant([0.0, 2 / 3, 1 / 3]) + hue
    full = tf.clip_by_value(tf.abs((wheel - tf.floor(wheel)) * 6 - 3) - 1, 0, 1)
    return 1 - saturation * (1 - full)


def ink_absorbances(paper: Paper) -> tuple[tf.Tensor, tf.Tensor]:
    """What the ink of the fine and of the heavy lines takes from red, green and blue: [3, 1, 1] each."""
    hue = tf.where(paper.ink_matches & paper.tinted, paper.hue, paper.ink_hue)
    value = 1 - paper.ink_darkness
    fine = 1 - tint(hue, paper.ink_saturation) * value
    heavy = 1 - tint(hue + paper.heavy_shift, paper.ink_saturation) * value
    return fine[:, None, None], tf.minimum(heavy * paper.heavy_darkness, 1)[:, None, None]


def _cell(position_mm: tf.Tensor, cells: int) -> tf.Tensor:
    """Which of the `cells` of a period each position falls into."""
    turns = position_mm * (1 / PERIOD_MM)
    # Rounding can lift a position just short of the period onto its end.
    return tf.minimum(tf.cast((turns - tf.floor(turns)) * cells, tf.int32), cells - 1)


def _sinc(x: tf.Tensor) -> tf.Tensor:
    angle = math.pi * x
    return tf.where(angle == 0, 1.0, tf.math.divide_no_nan(tf.sin(angle), angle))
