"""Millimetre paper (paper, section 3.1): ruling, ink, sheet, print and wear.

The ruling is C(x) = A sin(Bx + phi) + D for both axes and the 1, 5 and 10 mm families. A printed line is
sharper than one sine, so each family sums the sines of a line's Fourier series; each sine is attenuated by
the pixel's footprint, so a grid finer than two pixels per line fades to its mean instead of aliasing. With
line widths near half the pitch only the first sine is left, which is the paper's own formula.
"""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.ranges import Chance, Number

PERIOD_MM = 10
_HARMONICS = {1: 8, 5: 32, 10: 48}
NOISE_CELLS = 40


@dataclass(frozen=True)
class Paper:
    """One sheet. Strengths are absorbances in [0, 1] at a line's centre; hues are turns of the colour wheel."""

    hue: Number = (0.0, 1.0)
    tinted: Number = Chance(0.5)
    saturation: Number = (0.0, 0.25)
    brightness: Number = (0.8, 1.0)
    ink_hue: Number = (0.0, 1.0)
    ink_matches: Number = Chance(0.65)
    """The ink has the sheet's own hue, as on most tinted paper."""
    ink_saturation: Number = (0.25, 1.0)
    ink_darkness: Number = (0.15, 0.75)
    heavy_shift: Number = (-0.06, 0.06)
    """Hue of the 5 and 10 mm lines against the 1 mm lines."""
    heavy_darkness: Number = (0.8, 1.4)
    strength_1mm: Number = (0.25, 1.0)
    strength_5mm: Number = (0.1, 1.0)
    strength_10mm: Number = (0.2, 1.0)
    has_5mm: Number = Chance(0.72)
    has_10mm: Number = Chance(0.72)
    balance: Number = (0.75, 1.25)
    """Strength of the lines along y against those along x."""
    width_1mm: Number = (0.08, 0.3)
    width_5mm: Number = (0.12, 0.4)
    width_10mm: Number = (0.14, 0.55)
    ink_spread_mm: Number = (0.02, 0.14)
    """Standard deviation of the ink's edge: a large value leaves the paper's single sine."""
    phase_x: Number = (0.0, 10.0)
    phase_y: Number = (0.0, 10.0)
    gradient_weight: Number = (0.0, 0.05)
    gradient_cells: Number = (3, 14)
    voronoi_weight: Number = (0.0, 0.03)
    voronoi_cells: Number = (3, 8)
    simple_weight: Number = (0.0, 0.035)
    simple_cells: Number = (12, 38)
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


def samples_per_mm(size: tuple[int, int]) -> int:
    """Resolution of the ruling's tile: four samples a pixel at the closest view (70 mm across)."""
    return max(10, math.ceil(4 * max(size) / 70))


def line_profiles(paper: Paper, samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Ink coverage of the 1, 5 and 10 mm families over one period: [3, PERIOD_MM * samples] in [0, 1].

    A sum of A_k sin(B_k x + phi) + D; A_k is the Fourier coefficient of a line of its width, times the
    attenuation by ink spread (Gaussian) and by the pixel (sinc^2, the triangle filter that an antialiased
    bilinear resize applies to photographs).
    """
    position = (np.arange(PERIOD_MM * samples) + 0.5) / samples
    widths = {1: paper.width_1mm, 5: paper.width_5mm, 10: paper.width_10mm}
    rows = []
    for pitch, harmonics in _HARMONICS.items():
        frequency = np.arange(1, harmonics + 1, dtype=np.float32) / pitch
        sines = tf.constant(np.sin(2 * np.pi * frequency[:, None] * position + np.pi / 2), tf.float32)
        width = widths[pitch]
        amplitude = 2 * tf.sin(math.pi * frequency * width) / (math.pi * frequency * pitch)
        amplitude *= tf.exp(-2 * (math.pi * frequency * paper.ink_spread_mm) ** 2)
        amplitude *= _sinc(frequency * footprint_mm) ** 2
        rows.append(tf.linalg.matvec(sines, amplitude, transpose_a=True) + width / pitch)
    return tf.clip_by_value(tf.stack(rows), 0, 1)


def ruling_tile(paper: Paper, samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Transmittance of the ruling over one 10 mm square: [3, n, n], rows along y, n = PERIOD_MM * samples."""
    profiles = line_profiles(paper, samples, footprint_mm)
    # Without a heavy family the sheet would be a plain 1 mm grid, which is not sold: keep one of the two.
    has_10mm = tf.cast(paper.has_10mm | ~paper.has_5mm, tf.float32)
    strength_5mm = paper.strength_5mm * tf.cast(paper.has_5mm, tf.float32)
    strengths = tf.stack([paper.strength_1mm, strength_5mm, paper.strength_10mm * has_10mm])[:, None]
    across, down = 1 - profiles * strengths, 1 - profiles * tf.minimum(strengths * paper.balance, 1)
    fine = 1 - across[0] * down[0][:, None]
    heavy = 1 - (across[1] * across[2]) * (down[1] * down[2])[:, None]
    fine_ink, heavy_ink = ink_absorbances(paper)
    return (1 - fine * fine_ink) * (1 - heavy * heavy_ink)


def ruling(paper: Paper, x_mm: tf.Tensor, y_mm: tf.Tensor, samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Transmittance [3, H, W] of the ruling at sheet coordinates `x_mm`, `y_mm` [H, W]."""
    side = PERIOD_MM * samples
    tile = tf.transpose(tf.reshape(ruling_tile(paper, samples, footprint_mm), [3, -1]))
    column = _cell(x_mm + paper.phase_x, side)
    row = _cell(y_mm + paper.phase_y, side)
    flat = tf.reshape(tf.cast(row * side + column, tf.int32), [-1])
    return tf.reshape(tf.transpose(tf.gather(tile, flat)), [3, *x_mm.shape])


def colour(paper: Paper) -> tf.Tensor:
    """Base colour of the sheet [3, 1, 1] in [0, 1]."""
    saturation = paper.saturation * tf.cast(paper.tinted, tf.float32) + 0.02
    return tint(paper.hue, saturation)[:, None, None] * paper.brightness


def wear(paper: Paper, key: Key, size: tuple[int, int]) -> tuple[tf.Tensor, tf.Tensor]:
    """The blended noise L of the paper's section 3.1, and the ink's relative strength: both [H, W]."""
    nodes = NOISE_CELLS + 2
    lattices = key.uniform([4, nodes, nodes], Purpose.PAPER)
    jitter = key.uniform([2, noise.VORONOI_CELLS + 2, noise.VORONOI_CELLS + 2], Purpose.PAPER_VORONOI)
    fields = (
        noise.gradient(lattices[:2] * 2 - 1, size, cells=paper.gradient_cells),
        noise.voronoi(jitter, size, cells=paper.voronoi_cells),
        noise.simple(lattices[2], size, cells=paper.simple_cells),
    )
    weights = (paper.gradient_weight, paper.voronoi_weight, paper.simple_weight)
    strength = noise.upsample(lattices[3], size, cells=paper.simple_cells)
    return noise.blend(weights, fields), 1 - paper.print_wear * strength


def crease(paper: Paper, x_mm: tf.Tensor, y_mm: tf.Tensor, fov_mm: tf.Tensor) -> tf.Tensor:
    """Relief shading [H, W] of a fold across the sheet: one flank lit, the other in shade."""
    cosine, sine = tf.cos(paper.crease_angle), tf.sin(paper.crease_angle)
    distance = (x_mm * cosine + (y_mm * sine - paper.crease_offset * fov_mm)) / 1.2
    return paper.crease_depth * 2 * distance * tf.exp(-distance * distance)


def extent(
    paper: Paper, leaf_low: tf.Tensor, leaf_high: tf.Tensor, *, inset_mm: tf.Tensor | float = 0.0
) -> tuple[tf.Tensor, tf.Tensor]:
    """Corners [2] of the sheet, or of a rectangle `inset_mm` within it, around the leaf's bounding box."""
    low = leaf_low - tf.stack([paper.left, paper.top]) + inset_mm
    return low, leaf_high + tf.stack([paper.right, paper.bottom]) - inset_mm


def inside(
    low: tf.Tensor, high: tf.Tensor, x_mm: tf.Tensor, y_mm: tf.Tensor, px_per_mm: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Coverage [H, W] by the rectangle low..high, and the distance to its nearest side, mm (outside: < 0)."""
    across = tf.minimum(x_mm - low[0], high[0] - x_mm)
    distance = tf.minimum(across, tf.minimum(y_mm - low[1], high[1] - y_mm))
    return tf.clip_by_value(distance * px_per_mm + 0.5, 0, 1), distance


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


def _cell(position_mm: tf.Tensor, side: int) -> tf.Tensor:
    """Whole float cell 0..side - 1 of a position within its period."""
    turns = position_mm * (1 / PERIOD_MM)
    return tf.minimum(tf.floor((turns - tf.floor(turns)) * side), side - 1)


def _sinc(x: tf.Tensor) -> tf.Tensor:
    angle = math.pi * x
    return tf.math.divide_no_nan(tf.sin(angle), angle)
