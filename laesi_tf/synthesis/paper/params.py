"""Parameters of a sheet of millimetre paper."""

import math
from dataclasses import dataclass
from typing import Generic

from laesi_tf.synthesis.ranges import Value, choice, constant, interval, probability

KIND_NAMES = (
    "millimetre",
    "mm_1_2_10",
    "mm_2_10",
    "mm_4",
    "mm_5",
    "quarter_inch",
    "tenth_inch",
    "lines",
    "plain",
)
"""The kinds of paper; `laesi_tf.synthesis.paper.kinds` says which lines they have."""


@dataclass(frozen=True)
class PaperParams(Generic[Value]):
    """One sheet of paper (paper, section 3.1).

    Strengths are absorbances in [0, 1] at the centre of a line, hues are turns of the colour wheel, angles
    radians; `width_*` are line widths in mm, `phase_*` offsets of the ruling in mm, `*_cells` noise cells per
    image. On paper of another `kind` than millimetre paper, 1, 5 and 10 mm stand for its fine, medium and
    heavy lines, and the phases for tenths of its period.
    """

    hue: Value = interval(0.0, 1.0)
    tinted: Value = probability(0.5)
    saturation: Value = interval(0.0, 0.25)
    brightness: Value = interval(0.8, 1.0)
    ink_hue: Value = interval(0.0, 1.0)
    ink_matches: Value = probability(0.65)
    """The ink has the sheet's own hue, as on most tinted paper."""
    ink_saturation: Value = interval(0.25, 1.0)
    ink_darkness: Value = interval(0.2, 0.75)
    heavy_shift: Value = interval(-0.06, 0.06)
    """Hue of the 5 and 10 mm lines relative to that of the 1 mm lines."""
    heavy_darkness: Value = interval(0.8, 1.4)
    strength_1mm: Value = interval(0.35, 1.0)
    strength_5mm: Value = interval(0.1, 1.0)
    strength_10mm: Value = interval(0.2, 1.0)
    has_5mm: Value = probability(0.72)
    has_10mm: Value = probability(0.72)
    balance: Value = interval(0.75, 1.25)
    """Strength of the lines along y relative to those along x."""
    width_1mm: Value = interval(0.08, 0.3)
    width_5mm: Value = interval(0.12, 0.4)
    width_10mm: Value = interval(0.14, 0.55)
    ink_spread_mm: Value = interval(0.02, 0.12)
    """Standard deviation of the ink's edge: a large value leaves the paper's single sine."""
    phase_x: Value = interval(0.0, 10.0)
    phase_y: Value = interval(0.0, 10.0)
    gradient_weight: Value = interval(0.0, 0.05)
    gradient_cells: Value = interval(3, 14)
    voronoi_weight: Value = interval(0.0, 0.03)
    voronoi_cells: Value = interval(3, 8)
    simple_weight: Value = interval(0.0, 0.035)
    simple_cells: Value = interval(8, 26)
    print_wear: Value = interval(0.0, 0.5)
    """How much the strength of the ink varies over the sheet."""
    creased: Value = probability(0.18)
    crease_depth: Value = interval(0.03, 0.14)
    crease_angle: Value = interval(-math.pi, math.pi)
    crease_offset: Value = interval(-0.4, 0.4)
    """Distance of the crease from the image centre, in fields of view."""
    edged: Value = probability(0.42)
    """The sheet ends within or near the image."""
    left: Value = interval(2, 150)
    right: Value = interval(2, 150)
    top: Value = interval(2, 150)
    bottom: Value = interval(2, 150)
    """Distance from the leaf's bounding box to each side of the sheet, mm."""
    border_mm: Value = interval(-6, 10)
    """Unprinted border; below zero the printing runs off the sheet."""
    kind: Value = choice(*KIND_NAMES)
    dotted: Value = probability(0.0)
    """Dots where fine lines would cross, instead of the lines."""
    dot_mm: Value = constant(0.4)
    """Side of a dot, at most 0.4 of the pitch."""
    spacing_mm: Value = constant(8.0)
    """Distance of the lines of paper of kind `lines`."""
    cut: Value = probability(0.0)
    """The sheet's sides are cut at angles to the ruling; printing reaches them."""
    cut_left: Value = interval(-0.4, 0.4)
    cut_right: Value = interval(-0.4, 0.4)
    cut_top: Value = interval(-0.4, 0.4)
    cut_bottom: Value = interval(-0.4, 0.4)
    cut_turn: Value = interval(-math.pi, math.pi)
    """Angle of all sides to the ruling, to which those of single sides are added."""
    scrap: Value = probability(0.0)
    """The sheet is a scrap: `scrap_share` of each distance from the leaf to a side is left."""
    scrap_share: Value = interval(0.05, 0.3)
    empty: Value = probability(0.0)
    """No leaf lies on the sheet."""
