"""The leaf's outline, its mesh and its area (paper, section 3.2).

The outline is a piecewise cubic curve through control points P' = P + N, left and right sides drawn
separately, in leaf coordinates: x along the midrib from the blade's base (0) to its tip, y across, both in
millimetres. A petiole continues the midrib to negative x. Bend, teeth, lobes and bites are displacements of
the same curve, so mask, shadow and label all come from one polygon.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import curves, raster
from laesi_tf.synthesis.fusing import fused
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.ranges import Chance, Number

CONTROLS = 49
SIDE_POINTS = 640
PETIOLE_POINTS = 32
OUTLINE_POINTS = 2048
HOLES = 3
HOLE_POINTS = 40
BITES = 2


@dataclass(frozen=True)
class Leaf:
    """One kind of leaf. Lengths are fractions of the blade's length unless they say mm."""

    length_mm: Number = (35, 140)
    aspect: Number = (0.3, 0.75)
    """Width over length."""
    widest: Number = (0.35, 0.6)
    """Where along the midrib the blade is widest."""
    base_power: Number = (0.45, 0.9)
    """Half-width towards the base, (1 - d^2)^power: 0.5 round, 1 wedge, under 0.45 blunt."""
    tip_power: Number = (0.5, 1.2)
    """The same towards the tip: 0.5 round, 1 acute, above 1.2 drawn out."""
    cordate: Number = 0.0
    """How far the base reaches back past the petiole."""
    asymmetry: Number = (-0.06, 0.06)
    irregularity: Number = (0.003, 0.018)
    """Standard deviation of the control points' displacement N."""
    lobes: Number = (3, 6)
    lobe_depth: Number = 0.0
    lobe_sharpness: Number = 0.0
    """0: round lobes between sharp sinuses (oak); 1: spines between round sinuses (holly)."""
    lobe_lean: Number = (0.0, 0.12)
    waves: Number = (5, 11)
    wave_height: Number = (0.0, 0.012)
    teeth: Number = (12, 55)
    tooth_height: Number = (0.0, 0.008)
    roughness: Number = (0.0, 0.003)
    """Edge irregularities: standard deviation of fine displacements."""
    bend: Number = (-0.45, 0.45)
    """Turn of the midrib from base to tip, radians."""
    bend_change: Number = (-0.5, 0.5)
    bitten: Number = Chance(0.12)
    bite_depth: Number = (0.1, 0.6)
    holed: Number = Chance(0.15)
    hole_radius: Number = (0.008, 0.045)
    petiole: Number = (0.0, 0.22)
    petiole_width_mm: Number = (0.8, 2.4)
    petiole_bend: Number = (-1.2, 1.2)
    angle: Number = (-np.pi, np.pi)
    """Direction of the midrib against the ruling, radians."""
    veins: Number = (6, 13)
    """Secondary veins on each side."""
    vein_angle: Number = (0.6, 1.1)


KINDS: dict[str, tuple[float, Leaf]] = {
    "beech": (
        0.2,
        Leaf(
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
        Leaf(
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
        Leaf(
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
        Leaf(
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
        Leaf(
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
        Leaf(
            widest=(0.58, 0.74),
            base_power=(0.7, 1.2),
            tip_power=(0.38, 0.6),
            tooth_height=(0.0, 0.012),
        ),
    ),
    "deltoid": (
        0.06,
        Leaf(
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
        Leaf(
            length_mm=(30, 90),
            aspect=(0.4, 0.7),
            base_power=(0.5, 0.8),
            lobes=(3.2, 7),
            lobe_depth=(0.15, 0.42),
            lobe_sharpness=(0.85, 1.0),
        ),
    ),
}
"""Kinds of leaf with their relative frequency: the paper's beech and oak, and shapes around them that keep a
network trained on synthesis alone from taking every leaf for one of the two."""


class Ring(NamedTuple):
    """An outline through unevenly spaced `points` [n, 2], its `lengths`, and its points `passed`."""

    points: tf.Tensor
    travelled: tf.Tensor
    before: tf.Tensor


def outline(ring: Ring) -> tf.Tensor:
    """The closed outline in leaf coordinates, petiole included: [OUTLINE_POINTS, 2] mm, evenly spaced.

    Runs from the petiole's end along the left side to the tip and back along the right side.
    """
    return raster.spaced(*ring)


def ring(leaf: Leaf, key: Key) -> Ring:
    """The `outline` before its points are spaced evenly."""
    normals = key.normal([2, CONTROLS + 2 * _FINE, 2], Purpose.OUTLINE)
    points, travelled = _ring(leaf, normals, key.uniform([2, BITES, 3], Purpose.BITES))
    return Ring(points, travelled, raster.passed(travelled, OUTLINE_POINTS))


@fused
def _ring(leaf: Leaf, normals: tf.Tensor, bites: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """The outline [n, 2] through the points that its curves are made of, and its `lengths`."""
    controls, fine = normals[:, :CONTROLS], normals[:, CONTROLS:, 0]
    along, across = _blade(leaf, controls, fine, bites)
    along, across = along * leaf.length_mm, across * leaf.length_mm
    stalk = leaf.petiole_width_mm / 2 * tf.maximum(1 - along / leaf.length_mm, 0) ** 4
    across = tf.sqrt(across * across + stalk * stalk)
    reach, thickness = _petiole(leaf)
    way = tf.concat([reach, along[0], along[1, ::-1], reach[::-1]], axis=0)
    offset = tf.concat([-thickness, -across[0], across[1, ::-1], thickness[::-1]], axis=0)
    points = _bend(leaf, way, offset)
    return points, raster.lengths(points)


def hole_places(key: Key) -> tf.Tensor:
    """The numbers [HOLES, 8] in [0, 1) behind `holes`."""
    return key.uniform([HOLES, 8], Purpose.HOLES)


def holes(leaf: Leaf, place: tf.Tensor) -> tf.Tensor:
    """Outlines [HOLES, HOLE_POINTS, 2] mm of the leaf's holes at `hole_places`, turning against `outline`.

    A hole that is absent has radius zero and so no area. Each has its own stretch of the midrib and stays
    within the middle of the half-blade, so holes never meet each other or the margin. Bitten leaves have
    none: a bite may reach where a hole would be.
    """
    along = 0.28 + (tf.range(HOLES, dtype=tf.float32) + 0.2 + 0.6 * place[:, 0]) * (0.44 / HOLES)
    half_width = _half_width(leaf, along) * (1 - leaf.lobe_depth) * 0.5 * leaf.aspect
    side = tf.where(place[:, 1] < 0.5, -1.0, 1.0)
    across = side * half_width * (0.42 + 0.16 * place[:, 2])
    room = tf.minimum(half_width * 0.32, 0.4 * 0.44 / HOLES)
    radius = tf.minimum(leaf.hole_radius * (0.5 + place[:, 3]), room)
    radius *= tf.cast(leaf.holed & ~leaf.bitten, tf.float32) * tf.cast(place[:, 4] < 0.6, tf.float32)
    angle = tf.constant(np.linspace(0, 2 * np.pi, HOLE_POINTS, endpoint=False), tf.float32)
    turns = place[:, 5:] * 6.3
    wobble = 1 + 0.15 * tf.sin(2 * angle + turns[:, :1]) + 0.08 * tf.sin(3 * angle + turns[:, 1:2])
    reach = (radius[:, None] * wobble) / 1.23
    x = (along[:, None] + reach * tf.cos(angle)) * leaf.length_mm
    y = (across[:, None] - reach * tf.sin(angle)) * leaf.length_mm
    return _bend(leaf, x, y)


def mesh(points: tf.Tensor) -> tf.Tensor:
    """Triangles [n - 2, 3, 2] of an `outline` [n, 2]: a strip between its left and its right side."""
    half = points.shape[0] // 2
    left, right = points[:half], points[half:][::-1]
    near = tf.stack([left[:-1], left[1:], right[:-1]], axis=1)
    far = tf.stack([left[1:], right[1:], right[:-1]], axis=1)
    return tf.concat([near, far], axis=0)


def area_cm2(points: tf.Tensor, hole_points: tf.Tensor) -> tf.Tensor:
    """The label: summed area of the mesh triangles less the holes, cm2 (paper, "Data Preparation")."""
    blade = tf.abs(tf.reduce_sum(raster.area(mesh(points))))
    return (blade - tf.reduce_sum(tf.abs(raster.area(hole_points)))) / 100


_FINE = 96


def _half_width(leaf: Leaf, along: tf.Tensor) -> tf.Tensor:
    """Half-width profile in [0, 1] at `along` in [0, 1]: 1 where the blade is widest."""
    toward_base = along < leaf.widest
    distance = tf.where(toward_base, 1 - along / leaf.widest, (along - leaf.widest) / (1 - leaf.widest))
    power = tf.where(toward_base, leaf.base_power, leaf.tip_power)
    return tf.maximum(1 - distance * distance, 1e-6) ** power


def _blade(leaf: Leaf, jitter: tf.Tensor, fine: tf.Tensor, bites: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Both sides of the blade, (along, outward) [2, SIDE_POINTS] each, blade length 1."""
    s = tf.constant(np.linspace(0, 1, CONTROLS), tf.float32)
    along = 0.5 - 0.5 * tf.cos(np.pi * s)
    width = _half_width(leaf, along) * leaf.aspect / 2
    lobe, envelope = _lobes(leaf, along, jitter)
    side = tf.stack([1 + leaf.asymmetry, 1 - leaf.asymmetry])[:, None]
    width = width * side * (1 - leaf.lobe_depth * (1 - lobe) * envelope)
    x = along - leaf.cordate * (s / 0.1) * tf.exp(1 - s / 0.1)
    x = x + leaf.lobe_lean * leaf.lobe_depth * leaf.aspect * lobe * envelope
    spread = leaf.irregularity * leaf.aspect * tf.sin(np.pi * s)
    basis = tf.constant(curves.catmull_rom(CONTROLS, SIDE_POINTS).T)
    curve = (x + jitter[..., 0] * spread) @ basis, (width + jitter[..., 1] * spread) @ basis
    return _margin(leaf, curve, fine, bites)


def _lobes(leaf: Leaf, along: tf.Tensor, jitter: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Lobe profile in [0, 1] per side [2, CONTROLS], and where along the blade lobes can be."""
    shift = 0.25 * jitter[:, :1, 1]
    wander = tf.sin(4 * along + jitter[:, 1:2, 1] * 3) * 0.12
    crest = tf.abs(tf.sin(np.pi * (leaf.lobes * along**1.1 + shift + wander)))
    rounded = tf.sqrt(crest + 1e-4)
    spined = (1 - crest) ** 1.5
    profile = rounded + leaf.lobe_sharpness * (spined - rounded)
    return profile, tf.minimum(along * 6, 1) * tf.minimum((1 - along) * 8, 1)


def _margin(
    leaf: Leaf, curve: tuple[tf.Tensor, tf.Tensor], fine: tf.Tensor, bites: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Displace the curve along its normal by waves, teeth and roughness; then bite it."""
    s = np.linspace(0, 1, SIDE_POINTS, dtype=np.float32)
    saw = leaf.teeth * s + tf.constant([[0.0], [0.5]])
    saw = saw - tf.floor(saw)
    teeth = leaf.tooth_height * tf.minimum(saw * 1.3, (1 - saw) * 4.3)
    waves = leaf.wave_height * tf.sin(2 * np.pi * leaf.waves * s + fine[:, :1] * 3)
    rough = fine[:, _FINE:] @ tf.constant(curves.linear(_FINE, SIDE_POINTS).T)
    ends = tf.constant(np.minimum(np.minimum(s, 1 - s) * 12, 1), tf.float32)
    out = (teeth + waves + leaf.roughness * rough) * ends * tf.sqrt(leaf.aspect)
    step_x, step_y = (tf.pad(side[:, 2:] - side[:, :-2], [[0, 0], [1, 1]]) for side in curve)
    out *= tf.math.rsqrt(step_x * step_x + step_y * step_y + 1e-12)
    outward = tf.maximum(curve[1] + out * step_x, 0) * (1 - _notches(leaf, bites, s))
    return curve[0] - out * step_y, outward


def _notches(leaf: Leaf, bites: tf.Tensor, s: tf.Tensor) -> tf.Tensor:
    """How far [2, SIDE_POINTS] the margin is pulled towards the midrib where something ate of it."""
    centre = 0.15 + 0.7 * bites[:, :, :1]
    spread = 0.01 + 0.035 * bites[:, :, 1:2]
    distance = (s - centre) / spread
    depth = leaf.bite_depth * tf.cast(leaf.bitten & (bites[:, :, 2:] < 0.5), tf.float32)
    return tf.reduce_max(depth * tf.exp(-((distance * distance) ** 2)), axis=1)


def _petiole(leaf: Leaf) -> tuple[tf.Tensor, tf.Tensor]:
    """Distance along the midrib (negative) and half-thickness of the petiole's points, mm."""
    s = tf.constant(np.linspace(1, 0, PETIOLE_POINTS, endpoint=False), tf.float32)
    profile = tf.sqrt(tf.minimum((1 - s) * 12, 1)) * (1 + 0.5 * s**6)
    return -s * leaf.petiole * leaf.length_mm, leaf.petiole_width_mm / 2 * profile


def _bend(leaf: Leaf, along: tf.Tensor, across: tf.Tensor) -> tf.Tensor:
    """Lay (along, across) [...] mm around the bent midrib: points [..., 2] mm."""
    point, tangent = midrib(leaf, along)
    return point + across[..., None] * tf.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)


def midrib(leaf: Leaf, along: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Points and unit tangents [..., 2] of the midrib `along` mm from the base; the petiole bends by itself.

    The heading is a t + b t^2 (t in blade lengths); its integral is expanded to third order, which is
    within 1 % of the length at the ends of the ranges: a matter of shape, not of the label.
    """
    t = along / leaf.length_mm
    change = leaf.bend * leaf.bend_change
    heading = tf.where(t < 0, leaf.petiole_bend * t, leaf.bend * t + change * t * t)
    y = tf.where(t < 0, leaf.petiole_bend * t * t / 2, leaf.bend * t * t / 2 + change * t**3 / 3)
    shrink = tf.where(t < 0, leaf.petiole_bend**2, leaf.bend**2 * (1 + leaf.bend_change) ** 2)
    point = tf.stack([t - shrink * t**3 / 6, y], axis=-1) * leaf.length_mm
    return point, tf.stack([tf.cos(heading), tf.sin(heading)], axis=-1)
