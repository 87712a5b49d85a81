"""The leaf's outline, its mesh and its area (paper, section 3.2).

The outline is a piecewise cubic curve through control points P' = P + N, left and right sides drawn
separately, in leaf coordinates: x along the midrib from the blade's base (0) to its tip, y across, both in
millimetres. A petiole continues the midrib to negative x. Bend, teeth, lobes and bites are displacements of
the same curve, so mask, shadow and label all come from one polygon.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import curves, polygons
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.xla import compile_with_xla

CONTROLS = 49
SIDE_POINTS = 640
PETIOLE_POINTS = 32
OUTLINE_POINTS = 2048
BITES = 2


class OutlineCurve(NamedTuple):
    """An outline through unevenly spaced `points` [n, 2], its `lengths`, and its points `passed`."""

    points: tf.Tensor
    travelled: tf.Tensor
    before: tf.Tensor


def resample_outline(ring: OutlineCurve) -> tf.Tensor:
    """The closed outline in leaf coordinates, petiole included: [OUTLINE_POINTS, 2] mm, evenly spaced.

    Runs from the petiole's end along the left side to the tip and back along the right side.
    """
    return polygons.interpolate_at(*ring)


def sample_outline_curve(leaf: LeafParams, key: RandomStreams) -> OutlineCurve:
    """The `outline` before its points are spaced evenly."""
    normals = key.normal([2, CONTROLS + 2 * _ROUGHNESS_NODES, 2], Stream.OUTLINE)
    points, travelled = _trace_outline(leaf, normals, key.uniform([2, BITES, 3], Stream.BITES))
    return OutlineCurve(points, travelled, polygons.find_segments(travelled, OUTLINE_POINTS))


@compile_with_xla
def _trace_outline(leaf: LeafParams, normals: tf.Tensor, bites: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """The outline [n, 2] through the points that its curves are made of, and its `lengths`."""
    controls, fine = normals[:, :CONTROLS], normals[:, CONTROLS:, 0]
    along, across = _blade_sides(leaf, controls, fine, bites)
    along, across = along * leaf.length_mm, across * leaf.length_mm
    stalk = leaf.petiole_width_mm / 2 * tf.maximum(1 - along / leaf.length_mm, 0) ** 4
    across = tf.sqrt(across * across + stalk * stalk)
    reach, thickness = _petiole_sides(leaf)
    way = tf.concat([reach, along[0], along[1, ::-1], reach[::-1]], axis=0)
    offset = tf.concat([-thickness, -across[0], across[1, ::-1], thickness[::-1]], axis=0)
    points = bend_along_midrib(leaf, way, offset)
    return points, polygons.cumulative_lengths(points)


def outline_triangles(points: tf.Tensor) -> tf.Tensor:
    """Triangles [n - 2, 3, 2] of an `outline` [n, 2]: a strip between its left and its right side."""
    half = points.shape[0] // 2
    left, right = points[:half], points[half:][::-1]
    near = tf.stack([left[:-1], left[1:], right[:-1]], axis=1)
    far = tf.stack([left[1:], right[1:], right[:-1]], axis=1)
    return tf.concat([near, far], axis=0)


def leaf_area_cm2(points: tf.Tensor, hole_points: tf.Tensor) -> tf.Tensor:
    """The label: summed area of the mesh triangles less the holes, cm2 (paper, "Data Preparation")."""
    blade = tf.abs(tf.reduce_sum(polygons.signed_area(outline_triangles(points))))
    return (blade - tf.reduce_sum(tf.abs(polygons.signed_area(hole_points)))) / 100


_ROUGHNESS_NODES = 96


def half_width(leaf: LeafParams, along: tf.Tensor) -> tf.Tensor:
    """Half-width profile in [0, 1] at `along` in [0, 1]: 1 where the blade is widest."""
    toward_base = along < leaf.widest
    distance = tf.where(toward_base, 1 - along / leaf.widest, (along - leaf.widest) / (1 - leaf.widest))
    power = tf.where(toward_base, leaf.base_power, leaf.tip_power)
    return tf.maximum(1 - distance * distance, 1e-6) ** power


def _blade_sides(
    leaf: LeafParams, jitter: tf.Tensor, fine: tf.Tensor, bites: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Both sides of the blade, (along, outward) [2, SIDE_POINTS] each, blade length 1."""
    s = tf.constant(np.linspace(0, 1, CONTROLS), tf.float32)
    along = 0.5 - 0.5 * tf.cos(np.pi * s)
    width = half_width(leaf, along) * leaf.aspect / 2
    lobe, envelope = _lobe_profile(leaf, along, jitter)
    side = tf.stack([1 + leaf.asymmetry, 1 - leaf.asymmetry])[:, None]
    width = width * side * (1 - leaf.lobe_depth * (1 - lobe) * envelope)
    x = along - leaf.cordate * (s / 0.1) * tf.exp(1 - s / 0.1)
    x = x + leaf.lobe_lean * leaf.lobe_depth * leaf.aspect * lobe * envelope
    spread = leaf.irregularity * leaf.aspect * tf.sin(np.pi * s)
    basis = tf.constant(curves.catmull_rom(CONTROLS, SIDE_POINTS).T)
    curve = (x + jitter[..., 0] * spread) @ basis, (width + jitter[..., 1] * spread) @ basis
    return _displace_edge(leaf, curve, fine, bites)


def _lobe_profile(leaf: LeafParams, along: tf.Tensor, jitter: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Lobe profile in [0, 1] per side [2, CONTROLS], and where along the blade lobes can be."""
    shift = 0.25 * jitter[:, :1, 1]
    wander = tf.sin(4 * along + jitter[:, 1:2, 1] * 3) * 0.12
    crest = tf.abs(tf.sin(np.pi * (leaf.lobes * along**1.1 + shift + wander)))
    rounded = tf.sqrt(crest + 1e-4)
    spined = (1 - crest) ** 1.5
    profile = rounded + leaf.lobe_sharpness * (spined - rounded)
    return profile, tf.minimum(along * 6, 1) * tf.minimum((1 - along) * 8, 1)


def _displace_edge(
    leaf: LeafParams, curve: tuple[tf.Tensor, tf.Tensor], fine: tf.Tensor, bites: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Displace the curve along its normal by waves, teeth and roughness; then bite it."""
    s = np.linspace(0, 1, SIDE_POINTS, dtype=np.float32)
    saw = leaf.teeth * s + tf.constant([[0.0], [0.5]])
    saw = saw - tf.floor(saw)
    teeth = leaf.tooth_height * tf.minimum(saw * 1.3, (1 - saw) * 4.3)
    waves = leaf.wave_height * tf.sin(2 * np.pi * leaf.waves * s + fine[:, :1] * 3)
    rough = fine[:, _ROUGHNESS_NODES:] @ tf.constant(curves.linear(_ROUGHNESS_NODES, SIDE_POINTS).T)
    ends = tf.constant(np.minimum(np.minimum(s, 1 - s) * 12, 1), tf.float32)
    out = (teeth + waves + leaf.roughness * rough) * ends * tf.sqrt(leaf.aspect)
    step_x, step_y = (tf.pad(side[:, 2:] - side[:, :-2], [[0, 0], [1, 1]]) for side in curve)
    out *= tf.math.rsqrt(step_x * step_x + step_y * step_y + 1e-12)
    outward = tf.maximum(curve[1] + out * step_x, 0) * (1 - _bite_depth(leaf, bites, s))
    return curve[0] - out * step_y, outward


def _bite_depth(leaf: LeafParams, bites: tf.Tensor, s: tf.Tensor) -> tf.Tensor:
    """How far [2, SIDE_POINTS] the margin is pulled towards the midrib where something ate of it."""
    centre = 0.15 + 0.7 * bites[:, :, :1]
    spread = 0.01 + 0.035 * bites[:, :, 1:2]
    distance = (s - centre) / spread
    depth = leaf.bite_depth * tf.cast(leaf.bitten & (bites[:, :, 2:] < 0.5), tf.float32)
    return tf.reduce_max(depth * tf.exp(-((distance * distance) ** 2)), axis=1)


def _petiole_sides(leaf: LeafParams) -> tuple[tf.Tensor, tf.Tensor]:
    """Distance along the midrib (negative) and half-thickness of the petiole's points, mm."""
    s = tf.constant(np.linspace(1, 0, PETIOLE_POINTS, endpoint=False), tf.float32)
    profile = tf.sqrt(tf.minimum((1 - s) * 12, 1)) * (1 + 0.5 * s**6)
    return -s * leaf.petiole * leaf.length_mm, leaf.petiole_width_mm / 2 * profile


def bend_along_midrib(leaf: LeafParams, along: tf.Tensor, across: tf.Tensor) -> tf.Tensor:
    """Lay (along, across) [...] mm around the bent midrib: points [..., 2] mm."""
    point, tangent = midrib(leaf, along)
    return point + across[..., None] * tf.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)


def midrib(leaf: LeafParams, along: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
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
