"""The printed lines of millimetre paper (paper, section 3.1).

The ruling is C(x) = A sin(Bx + phi) + D for both axes and the 1, 5 and 10 mm families. A printed line is
sharper than one sine, so each family sums the sines of a line's Fourier series; each sine is attenuated by
the pixel's footprint, so a ruling finer than two pixels per line fades to its mean instead of aliasing. With
line widths near half the pitch only the first sine is left, which is the paper's own formula.

Where ranges have other kinds of paper, families and period are those of the kind that is sampled, and fine
lines may be dots.
"""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.camera.view import CameraView
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.paper.kinds import LONGEST_PERIOD_MM, PrintedLines, place_in_period, printed_lines
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.ranges import Scalar

PERIOD_MM = 10
_PITCHES = (1, 5, 10)
_HARMONICS = (8, 32, 48)
_FREQUENCY = np.concatenate(
    [np.arange(1, n + 1) / pitch for n, pitch in zip(_HARMONICS, _PITCHES, strict=True)]
)
"""Spatial frequencies B / 2 pi of all sines, cycles per mm, family after family."""
_MEMBERSHIP = np.repeat(np.eye(len(_PITCHES), dtype=np.float32), _HARMONICS, axis=1)
_UNIT = 2**16 - 1
_ORDERS = 160
"""Sines of a profile of any kind: wavelengths down to 0.16 mm on the longest period."""


def samples_per_mm(size: ImageSize) -> int:
    """Return the resolution of the line profiles: four samples per pixel at the closest view, 70 mm wide."""
    return max(10, math.ceil(4 * max(size) / 70))


def samples_of_any_kind(size: ImageSize) -> int:
    """Return the samples of a period of any kind of paper: four per pixel of the longest, 30 mm wide."""
    return math.ceil(4 * max(size) / 30 * LONGEST_PERIOD_MM)


def compute_ruling_cells(
    paper: PaperParams[Scalar], view: CameraView, size: ImageSize, components: tuple[str, ...]
) -> tf.Tensor:
    """Return which sample of the x and of the y profile lies under each pixel: int32 [2, H, W]."""
    x_mm, y_mm = view.pixel_centres_to_sheet(size)
    if "paper_kinds" in components:
        return kind_cells(paper, samples_of_any_kind(size), x_mm, y_mm)
    return ruling_cells(paper, samples_per_mm(size), x_mm, y_mm)


def kind_cells(paper: PaperParams[Scalar], samples: int, x_mm: tf.Tensor, y_mm: tf.Tensor) -> tf.Tensor:
    """Return which of the `samples` of the x and of the y profile lie at the places: int32 [2, ...]."""
    return _cell_of_turns(place_in_period(paper, x_mm, y_mm), samples)


def ruling_cells(paper: PaperParams[Scalar], samples: int, x_mm: tf.Tensor, y_mm: tf.Tensor) -> tf.Tensor:
    """Return which sample of the x and of the y profile lies at `x_mm` and `y_mm` [...]: int32 [2, ...]."""
    cells = PERIOD_MM * samples
    return tf.stack([_cell(x_mm + paper.phase_x, cells), _cell(y_mm + paper.phase_y, cells)])


def _cell(position_mm: tf.Tensor, cells: int) -> tf.Tensor:
    """Return which of the `cells` of a period each position falls into."""
    return _cell_of_turns(position_mm * (1 / PERIOD_MM), cells)


def _cell_of_turns(turns: tf.Tensor, cells: int) -> tf.Tensor:
    # Rounding can lift a position just below the period onto its end.
    return tf.minimum(tf.cast((turns - tf.floor(turns)) * cells, tf.int32), cells - 1)


def pack_line_transmission(paper: PaperParams[Scalar], samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Return the light that passes fine and heavy lines, across x and down y, over one period: int32 [2, n].

    A ruling is a product of lines along either axis, so two profiles hold all of it. Each number holds the
    transmission of the fine lines in its upper and of the heavy lines in its lower 16 bits, in 65535ths:
    `look_up_line_coverage` then looks up both at once, since looking up costs more than all else that it
    does.
    """
    profiles = line_profiles(paper, samples, footprint_mm)
    strengths = _line_strengths(paper, printed_lines(paper))[:, None]
    across, down = 1 - profiles * strengths, 1 - profiles * tf.minimum(strengths * paper.balance, 1)
    return _pack_pairs(across, down)


def pack_kind_transmission(paper: PaperParams[Scalar], samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Return the same as `pack_line_transmission` for a sheet of any kind: int32 [2, samples].

    Dots need the square root of their strength: their coverage is the product of both profiles.
    """
    lines = printed_lines(paper)
    profiles = kind_profiles(paper, lines, samples, footprint_mm)
    strengths = _line_strengths(paper, lines)
    down = tf.minimum(strengths * paper.balance, 1)
    is_root = tf.stack([paper.dotted, tf.constant(False), tf.constant(False)])
    across, down = (tf.where(is_root, tf.sqrt(strength), strength) for strength in (strengths, down))
    across *= tf.cast(lines.is_crossed, tf.float32)
    return _pack_pairs(1 - profiles * across[:, None], 1 - profiles * down[:, None])


def _line_strengths(paper: PaperParams[Scalar], lines: PrintedLines) -> tf.Tensor:
    """Return the strengths [3] of fine, medium and heavy lines, 0 for those that the sheet lacks."""
    strengths = tf.stack([paper.strength_1mm, paper.strength_5mm, paper.strength_10mm])
    return strengths * tf.cast(lines.per_period > 0, tf.float32)


def kind_profiles(
    paper: PaperParams[Scalar], lines: PrintedLines, samples: int, footprint_mm: tf.Tensor
) -> tf.Tensor:
    """Return the ink coverage in [0, 1] of the families of a sheet of any kind over one period: [3, samples].

    As `line_profiles`, but with one set of sines: a family has those of which its number of lines per period
    is a divisor.
    """
    order = np.arange(1, _ORDERS + 1)
    position = (np.arange(samples) + 0.5) / samples
    ratio = order / tf.maximum(lines.per_period, 1)[:, None]
    series = LineSeries(
        tf.constant(order, tf.float32) / lines.period_mm,
        tf.cast(tf.abs(ratio - tf.round(ratio)) < 1e-3, tf.float32),
        tf.constant(np.cos(2 * np.pi * order[:, None] * position), tf.float32),
    )
    pitches = lines.period_mm / tf.maximum(lines.per_period, 1)
    fine = tf.where(paper.dotted, paper.dot_mm, paper.width_1mm)
    widths = tf.minimum(tf.stack([fine, paper.width_5mm, paper.width_10mm]), 0.4 * pitches)
    return _sum_series(series, widths, widths / pitches, paper.ink_spread_mm, footprint_mm)


def _pack_pairs(across: tf.Tensor, down: tf.Tensor) -> tf.Tensor:
    """Pack the transmissions [3, n] of fine, medium and heavy lines across x and down y: int32 [2, n]."""
    fine = tf.stack([across[0], down[0]])
    heavy = tf.stack([across[1] * across[2], down[1] * down[2]])
    whole = tf.cast(tf.stack([fine, heavy]) * _UNIT + 0.5, tf.int32)
    return tf.bitwise.bitwise_or(tf.bitwise.left_shift(whole[0], 16), whole[1])


def line_profiles(paper: PaperParams[Scalar], samples: int, footprint_mm: tf.Tensor) -> tf.Tensor:
    """Return the ink coverage in [0, 1] of the 1, 5 and 10 mm families over one period: [3, n].

    A sum of A_k sin(B_k x + phi) + D; A_k is the Fourier coefficient of a line of its width, times the
    attenuation by ink spread (Gaussian) and by the pixel (sinc^2, the triangle filter that an antialiased
    bilinear resize applies to photos). `samples` are per mm, n = PERIOD_MM * samples; `footprint_mm` is the
    side of a pixel on the sheet.
    """
    position = (np.arange(PERIOD_MM * samples) + 0.5) / samples
    series = LineSeries(
        tf.constant(_FREQUENCY, tf.float32),
        tf.constant(_MEMBERSHIP),
        tf.constant(np.sin(2 * np.pi * _FREQUENCY[:, None] * position + np.pi / 2), tf.float32),
    )
    widths = tf.stack([paper.width_1mm, paper.width_5mm, paper.width_10mm])
    share = widths / tf.constant(_PITCHES, tf.float32)
    return _sum_series(series, widths, share, paper.ink_spread_mm, footprint_mm)


class LineSeries(NamedTuple):
    """The sines from which profiles are summed.

    Their `frequency` [k] in cycles per mm, 1 where family f has sine k in `membership` [f, k], and `sines`
    [k, n] themselves over one period.
    """

    frequency: tf.Tensor
    membership: tf.Tensor
    sines: tf.Tensor


def _sum_series(
    series: LineSeries, widths: tf.Tensor, share: tf.Tensor, spread_mm: tf.Tensor, footprint_mm: tf.Tensor
) -> tf.Tensor:
    """Return the profiles [f, n] of lines of `widths` [f] mm that cover the `share` [f] of the sheet."""
    frequency = series.frequency
    amplitude = tf.exp(-2 * (math.pi * spread_mm * frequency) ** 2) * _sinc(frequency * footprint_mm) ** 2
    coefficients = 2 * share[:, None] * _sinc(widths[:, None] * frequency) * amplitude
    return tf.clip_by_value((coefficients * series.membership) @ series.sines + share[:, None], 0, 1)


def _sinc(x: tf.Tensor) -> tf.Tensor:
    angle = math.pi * x
    return tf.where(angle == 0, 1.0, tf.math.divide_no_nan(tf.sin(angle), angle))


def look_up_line_coverage(
    transmission: tf.Tensor, cells: tf.Tensor, *, dotted: tf.Tensor | None = None
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the coverage [H, W] by fine and by heavy lines.

    `transmission` comes from `pack_line_transmission` or `pack_kind_transmission`, `cells` [2, H, W] from
    `compute_ruling_cells`. Where `dotted`, fine lines cover only where they cross.
    """
    (fine_x, heavy_x), (fine_y, heavy_y) = (
        _unpack_pair(tf.gather(transmission[axis], cells[axis])) for axis in range(2)
    )
    fine, heavy = 1 - fine_x * fine_y, 1 - heavy_x * heavy_y
    return fine if dotted is None else tf.where(dotted, (1 - fine_x) * (1 - fine_y), fine), heavy


def _unpack_pair(pair: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the two numbers in [0, 1] that each int32 of `pair` holds."""
    upper = tf.bitwise.bitwise_and(tf.bitwise.right_shift(pair, 16), _UNIT)
    lower = tf.bitwise.bitwise_and(pair, _UNIT)
    return tf.cast(upper, tf.float32) / _UNIT, tf.cast(lower, tf.float32) / _UNIT


def compute_ink_absorbance(paper: PaperParams[Scalar], fine: tf.Tensor, heavy: tf.Tensor) -> tf.Tensor:
    """Return what the inks absorb, [3, H, W], where fine and heavy lines cover `fine` and `heavy` [H, W]."""
    fine_ink, heavy_ink = ink_absorbances(paper)
    return 1 - (1 - fine * fine_ink) * (1 - heavy * heavy_ink)


def ink_absorbances(paper: PaperParams[Scalar]) -> tuple[tf.Tensor, tf.Tensor]:
    """Return what the ink of fine and of heavy lines absorbs of red, green and blue: [3, 1, 1] each."""
    hue = tf.where(paper.ink_matches & paper.tinted, paper.hue, paper.ink_hue)
    value = 1 - paper.ink_darkness
    fine = 1 - hsv_to_rgb(hue, paper.ink_saturation) * value
    heavy = 1 - hsv_to_rgb(hue + paper.heavy_shift, paper.ink_saturation) * value
    return fine[:, None, None], tf.minimum(heavy * paper.heavy_darkness, 1)[:, None, None]
