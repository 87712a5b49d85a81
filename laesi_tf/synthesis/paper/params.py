"""Parameters of a sheet of millimetre paper."""

import math
from dataclasses import dataclass

from laesi_tf.synthesis.ranges import Number, Probability


@dataclass(frozen=True)
class PaperParams:
    """One sheet. Strengths are absorbances in [0, 1] at a line's centre, hues turns of the colour wheel."""

    hue: Number = (0.0, 1.0)
    tinted: Number = Probability(0.5)
    saturation: Number = (0.0, 0.25)
    brightness: Number = (0.8, 1.0)
    ink_hue: Number = (0.0, 1.0)
    ink_matches: Number = Probability(0.65)
    """The ink has the sheet's own hue, as on most tinted paper."""
    ink_saturation: Number = (0.25, 1.0)
    ink_darkness: Number = (0.2, 0.75)
    heavy_shift: Number = (-0.06, 0.06)
    """Hue of the 5 and 10 mm lines against the 1 mm lines."""
    heavy_darkness: Number = (0.8, 1.4)
    strength_1mm: Number = (0.35, 1.0)
    strength_5mm: Number = (0.1, 1.0)
    strength_10mm: Number = (0.2, 1.0)
    has_5mm: Number = Probability(0.72)
    has_10mm: Number = Probability(0.72)
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
    creased: Number = Probability(0.18)
    crease_depth: Number = (0.03, 0.14)
    crease_angle: Number = (-math.pi, math.pi)
    crease_offset: Number = (-0.4, 0.4)
    """Distance of the crease from the picture's centre, in fields of view."""
    edged: Number = Probability(0.42)
    """The sheet ends within or near the frame."""
    left: Number = (2, 150)
    right: Number = (2, 150)
    top: Number = (2, 150)
    bottom: Number = (2, 150)
    """Room between the leaf's extent and each side of the sheet, mm."""
    border_mm: Number = (-6, 10)
    """Unprinted border; below zero the printing runs off the sheet."""
