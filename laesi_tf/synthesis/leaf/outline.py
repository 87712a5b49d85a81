"""The leaf's outline (paper, section 3.2).

The outline is a piecewise cubic curve through control points P' = P + N, left and right sides separately, in
leaf coordinates: x along the midrib from the blade's base (0) to its tip, y across, both in mm. A petiole
continues the midrib to negative x. Bend, serration, lobes and bites are displacements of the same curve, so
mask, shadow and label all come from one polygon.
"""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import curves
from laesi_tf.synthesis.geometry import cumulative_lengths
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.ranges import Scalar

CONTROLS = 49
SIDE_POINTS = 640
PETIOLE_POINTS = 32
OUTLINE_POINTS = 2048
BITES = 2
ROUGHNESS_NODES = 96
_SIDE_BASIS = curves.catmull_rom(CONTROLS, SIDE_POINTS).T
_ROUGHNESS_BASIS = curves.linear(ROUGHNESS_NODES, SIDE_POINTS).T


class OutlineNumbers(NamedTuple):
    """Random numbers of an outline: standard normal `normals` [2, n, 2] and uniform `bites` [2, BITES, 3]."""

    normals: tf.Tensor
    bites: tf.Tensor


class OutlineCurve(NamedTuple):
    """An outline through unevenly spaced `points` [n, 2] mm, to be interpolated at even distances.

    `lengths` [n + 1] are its `cumulative_lengths`, `segments` [OUTLINE_POINTS] come from `find_segments`.
    """

    points: tf.Tensor
    lengths: tf.Tensor
    segments: tf.Tensor


def trace_outline(leaf: LeafParams[Scalar], numbers: OutlineNumbers) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the outline's points [n, 2] in leaf coordinates, mm, and their cumulative lengths [n + 1].

    The points are unevenly spaced. The outline runs from the petiole's end along the left side to the tip and
    back along the right side.
    """
    controls, fine = numbers.normals[:, :CONTROLS], numbers.normals[:, CONTROLS:, 0]
    along, across = _blade_sides(leaf, controls, fine, numbers.bites)
    along, across = along * leaf.length_mm, across * leaf.length_mm
    stalk = leaf.petiole_width_mm / 2 * tf.maximum(1 - along / leaf.length_mm, 0) ** 4
    across = tf.sqrt(across * across + stalk * stalk)
    petiole_along, petiole_across = _petiole_side(leaf)
    path = tf.concat([petiole_along, along[0], along[1, ::-1], petiole_along[::-1]], axis=0)
    offset = tf.concat([-petiole_across, -across[0], across[1, ::-1], petiole_across[::-1]], axis=0)
    points = bend_along_midrib(leaf, path, offset)
    return points, cumulative_lengths(points)


def half_width(leaf: LeafParams[Scalar], along: tf.Tensor) -> tf.Tensor:
    """Return the half-width in [0, 1], relative to the widest place, at `along` in [0, 1] of the midrib."""
    toward_base = along < leaf.widest
    distance = tf.where(toward_base, 1 - along / leaf.widest, (along - leaf.widest) / (1 - leaf.widest))
    power = tf.where(toward_base, leaf.base_power, leaf.tip_power)
    return tf.maximum(1 - distance * distance, 1e-6) ** power


def _blade_sides(
    leaf: LeafParams[Scalar], jitter: tf.Tensor, fine: tf.Tensor, bites: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return both sides of the blade, (along, outward) [2, SIDE_POINTS] each, in blade lengths."""
    s = tf.constant(np.linspace(0, 1, CONTROLS), tf.float32)
    along = 0.5 - 0.5 * tf.cos(math.pi * s)
    width = half_width(leaf, along) * leaf.aspect / 2
    lobe, envelope = _lobe_profile(leaf, along, jitter)
    side = tf.stack([1 + leaf.asymmetry, 1 - leaf.asymmetry])[:, None]
    width = width * side * (1 - leaf.lobe_depth * (1 - lobe) * envelope)
    x = along - leaf.cordate * (s / 0.1) * tf.exp(1 - s / 0.1)
    x = x + leaf.lobe_lean * leaf.lobe_depth * leaf.aspect * lobe * envelope
    sigma = leaf.irregularity * leaf.aspect * tf.sin(math.pi * s)
    curve = (x + jitter[..., 0] * sigma) @ _SIDE_BASIS, (width + jitter[..., 1] * sigma) @ _SIDE_BASIS
    return _displace_edge(leaf, curve, fine, bites)


def _lobe_profile(
    leaf: LeafParams[Scalar], along: tf.Tensor, jitter: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the lobe profile in [0, 1] per side [2, CONTROLS], and where along the blade lobes can be."""
    shift = 0.25 * jitter[:, :1, 1]
    wander = tf.sin(4 * along + jitter[:, 1:2, 1] * 3) * 0.12
    crest = tf.abs(tf.sin(math.pi * (leaf.lobes * along**1.1 + shift + wander)))
    rounded = tf.sqrt(crest + 1e-4)
    spined = (1 - crest) ** 1.5
    profile = rounded + leaf.lobe_sharpness * (spined - rounded)
    return profile, tf.minimum(along * 6, 1) * tf.minimum((1 - along) * 8, 1)


def _displace_edge(
    leaf: LeafParams[Scalar], curve: tuple[tf.Tensor, tf.Tensor], fine: tf.Tensor, bites: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Displace the curve along its normal by waves, serration and roughness; then bite it."""
    s = np.linspace(0, 1, SIDE_POINTS, dtype=np.float32)
    saw = leaf.tooth_count * s + tf.constant([[0.0], [0.5]])
    saw = saw - tf.floor(saw)
    serration = leaf.tooth_height * tf.minimum(saw * 1.3, (1 - saw) * 4.3)
    waves = leaf.wave_height * tf.sin(2 * math.pi * leaf.waves * s + fine[:, :1] * 3)
    rough = fine[:, ROUGHNESS_NODES:] @ _ROUGHNESS_BASIS
    ends = tf.constant(np.minimum(np.minimum(s, 1 - s) * 12, 1), tf.float32)
    out = (serration + waves + leaf.roughness * rough) * ends * tf.sqrt(leaf.aspect)
    step_x, step_y = (tf.pad(side[:, 2:] - side[:, :-2], [[0, 0], [1, 1]]) for side in curve)
    out *= tf.math.rsqrt(step_x * step_x + step_y * step_y + 1e-12)
    outward = tf.maximum(curve[1] + out * step_x, 0) * (1 - _bite_depth(leaf, bites, s))
    return curve[0] - out * step_y, outward


def _bite_depth(leaf: LeafParams[Scalar], bites: tf.Tensor, s: np.ndarray) -> tf.Tensor:
    """Return how far [2, SIDE_POINTS] bites pull the edge towards the midrib: 0 not at all, 1 onto it."""
    centre = 0.15 + 0.7 * bites[:, :, :1]
    sigma = 0.01 + 0.035 * bites[:, :, 1:2]
    distance = (s - centre) / sigma
    depth = leaf.bite_depth * tf.cast(leaf.bitten & (bites[:, :, 2:] < 0.5), tf.float32)
    return tf.reduce_max(depth * tf.exp(-((distance * distance) ** 2)), axis=1)


def _petiole_side(leaf: LeafParams[Scalar]) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the distance along the midrib (negative) and the half-thickness of the petiole's points, mm."""
    s = tf.constant(np.linspace(1, 0, PETIOLE_POINTS, endpoint=False), tf.float32)
    profile = tf.sqrt(tf.minimum((1 - s) * 12, 1)) * (1 + 0.5 * s**6)
    return -s * leaf.petiole * leaf.length_mm, leaf.petiole_width_mm / 2 * profile


def bend_along_midrib(leaf: LeafParams[Scalar], along: tf.Tensor, across: tf.Tensor) -> tf.Tensor:
    """Map (along, across) [...] mm of a straight leaf to points [..., 2] mm around the bent midrib."""
    point, tangent = midrib(leaf, along)
    return point + across[..., None] * tf.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)


def midrib(leaf: LeafParams[Scalar], along: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return points and unit tangents [..., 2] of the midrib `along` mm from the base.

    The petiole has its own bend. The heading is a t + b t^2 (t in blade lengths); its integral is expanded to
    third order, which is within 1 % of the length at the ends of the ranges: that affects the shape, not the
    label.
    """
    t = along / leaf.length_mm
    change = leaf.bend * leaf.bend_change
    heading = tf.where(t < 0, leaf.petiole_bend * t, leaf.bend * t + change * t * t)
    y = tf.where(t < 0, leaf.petiole_bend * t * t / 2, leaf.bend * t * t / 2 + change * t**3 / 3)
    shrink = tf.where(t < 0, leaf.petiole_bend**2, leaf.bend**2 * (1 + leaf.bend_change) ** 2)
    point = tf.stack([t - shrink * t**3 / 6, y], axis=-1) * leaf.length_mm
    return point, tf.stack([tf.cos(heading), tf.sin(heading)], axis=-1)
