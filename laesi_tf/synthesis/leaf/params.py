"""Parameters of a leaf's shape, and the kinds of leaves."""

import math
from dataclasses import dataclass
from typing import Generic

from laesi_tf.synthesis.ranges import Range, Value, constant, interval, probability


@dataclass(frozen=True)
class LeafParams(Generic[Value]):
    """One kind of leaf.

    Lengths are fractions of the blade's length unless the name says mm; angles are radians.
    """

    length_mm: Value = interval(35, 140)
    aspect: Value = interval(0.3, 0.75)
    """Width over length."""
    widest: Value = interval(0.35, 0.6)
    """Where along the midrib the blade is widest."""
    base_power: Value = interval(0.45, 0.9)
    """Half-width towards the base, (1 - d^2)^power: 0.5 round, 1 wedge, under 0.45 blunt."""
    tip_power: Value = interval(0.5, 1.2)
    """The same towards the tip: 0.5 round, 1 acute, above 1.2 drawn out."""
    cordate: Value = constant(0.0)
    """How far the base extends back past the petiole."""
    asymmetry: Value = interval(-0.06, 0.06)
    irregularity: Value = interval(0.003, 0.018)
    """Standard deviation of the control points' displacement N."""
    lobes: Value = interval(3, 6)
    lobe_depth: Value = constant(0.0)
    lobe_sharpness: Value = constant(0.0)
    """0: round lobes between sharp sinuses (oak); 1: spines between round sinuses (holly)."""
    lobe_lean: Value = interval(0.0, 0.12)
    waves: Value = interval(5, 11)
    wave_height: Value = interval(0.0, 0.012)
    tooth_count: Value = interval(12, 55)
    tooth_height: Value = interval(0.0, 0.008)
    roughness: Value = interval(0.0, 0.003)
    """Edge irregularities: standard deviation of fine displacements."""
    bend: Value = interval(-0.45, 0.45)
    """Turn of the midrib from base to tip."""
    bend_change: Value = interval(-0.5, 0.5)
    bitten: Value = probability(0.12)
    bite_depth: Value = interval(0.1, 0.6)
    holed: Value = probability(0.15)
    hole_radius: Value = interval(0.008, 0.045)
    petiole: Value = interval(0.0, 0.22)
    petiole_width_mm: Value = interval(0.8, 2.4)
    petiole_bend: Value = interval(-1.2, 1.2)
    angle: Value = interval(-math.pi, math.pi)
    """Direction of the midrib relative to the ruling."""
    veins: Value = interval(6, 13)
    """Secondary veins on each side."""
    vein_angle: Value = interval(0.6, 1.1)
    lift_mm: Value = constant(0.0)
    """Height of the blade's upper side above the paper: a camera sees what is nearer to it larger."""


LEAF_KINDS: dict[str, tuple[float, LeafParams[Range]]] = {
    "beech": (
        0.2,
        LeafParams(
            aspect=(0.5, 0.74),
            widest=(0.4, 0.56),
            base_power=(0.45, 0.65),
            tip_power=(0.6, 0.95),
            wave_height=(0.002, 0.022),
            tooth_height=(0.0, 0.004),
            veins=(6, 10),
            vein_angle=(0.65, 0.9),
        ),
    ),
    "oak": (
        0.22,
        LeafParams(
            aspect=(0.45, 0.8),
            widest=(0.5, 0.66),
            base_power=(0.6, 1.1),
            tip_power=(0.45, 0.65),
            lobes=(3.2, 7.2),
            lobe_depth=(0.15, 0.62),
            lobe_sharpness=(0.0, 0.12),
            lobe_lean=(0.02, 0.16),
            irregularity=(0.006, 0.016),
            tooth_height=(0.0, 0.004),
            veins=(4, 8),
        ),
    ),
    "ovate": (
        0.2,
        LeafParams(
            aspect=(0.45, 0.95),
            widest=(0.24, 0.46),
            base_power=(0.36, 0.7),
            tip_power=(0.75, 1.7),
            cordate=(0.0, 0.05),
            tooth_height=(0.0, 0.018),
            petiole=(0.0, 0.35),
        ),
    ),
    "lanceolate": (
        0.12,
        LeafParams(
            aspect=(0.11, 0.36),
            widest=(0.35, 0.58),
            base_power=(0.55, 1.2),
            tip_power=(0.7, 1.6),
            asymmetry=(-0.03, 0.03),
            irregularity=(0.001, 0.006),
            wave_height=(0.0, 0.005),
            tooth_height=(0.0, 0.004),
            veins=(8, 14),
        ),
    ),
    "orbicular": (
        0.1,
        LeafParams(
            length_mm=(30, 110),
            aspect=(0.78, 1.05),
            widest=(0.42, 0.56),
            base_power=(0.4, 0.55),
            tip_power=(0.45, 0.7),
            cordate=(0.0, 0.07),
            petiole=(0.0, 0.35),
            tooth_height=(0.0, 0.012),
            veins=(4, 8),
        ),
    ),
    "obovate": (
        0.06,
        LeafParams(
            widest=(0.58, 0.74),
            base_power=(0.7, 1.2),
            tip_power=(0.38, 0.6),
            tooth_height=(0.0, 0.012),
        ),
    ),
    "deltoid": (
        0.06,
        LeafParams(
            length_mm=(30, 110),
            aspect=(0.75, 1.05),
            widest=(0.16, 0.28),
            base_power=(0.34, 0.6),
            tip_power=(0.8, 1.5),
            tooth_height=(0.0, 0.014),
            petiole=(0.1, 0.4),
            veins=(4, 7),
        ),
    ),
    "spiny": (
        0.04,
        LeafParams(
            length_mm=(30, 90),
            aspect=(0.4, 0.7),
            base_power=(0.5, 0.8),
            lobes=(3.2, 7),
            lobe_depth=(0.15, 0.42),
            lobe_sharpness=(0.85, 1.0),
        ),
    ),
}
"""Kinds of leaf with their relative frequency.

The paper's beech and oak, and shapes around them that keep a network trained on synthetic images alone from
taking every leaf for one of the two.
"""
