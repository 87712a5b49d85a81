"""Light: the leaf's shadow S(s, p, sz), uneven illumination, and a glass pane (paper, "Rendering").

Shadows and illumination are smooth, so they are made on a lattice a fraction of the picture's size and
interpolated. The numbers of this room are drawn once per lighting pass: the passes over one leaf differ in
nothing else.
"""

import math
from dataclasses import dataclass

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.filters import blur_and_shift
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Number, Probability


@dataclass(frozen=True)
class LightParams:
    """One lighting of the scene."""

    strength: Number = (0.08, 0.6)
    """s: how much of the light the leaf's shadow takes."""
    direction: Number = (-math.pi, math.pi)
    offset_mm: Number = (0.0, 3.5)
    """p: the shadow's displacement, in polar form with `direction`."""
    softness_mm: Number = (0.35, 3.5)
    """sz: standard deviation of the shadow's edge."""
    slope: Number = (0.0, 0.4)
    """Fall-off of the light across the picture."""
    vignette: Number = (0.0, 0.35)
    unevenness: Number = (0.0, 0.1)
    cast: Number = Probability(0.35)
    """Something outside the frame (a hand, the phone) shades part of the picture."""
    cast_strength: Number = (0.1, 0.55)
    cast_softness: Number = (0.01, 0.12)
    cast_offset: Number = (-0.45, 0.45)
    cast_angle: Number = (-math.pi, math.pi)
    relief: Number = (0.1, 0.9)
    """Strength of the shading by the leaf's normals."""
    gloss: Number = (0.0, 0.35)
    glass: Number = Probability(0.16)
    glass_strength: Number = (0.05, 0.4)
    glass_angle: Number = (-math.pi, math.pi)
    glass_offset: Number = (-0.4, 0.4)
    glass_width: Number = (0.06, 0.35)
    glass_veil: Number = (0.0, 0.1)


GRID_NODES = 28


def light_direction(light: LightParams) -> tf.Tensor:
    """Unit vector [2] along which the light travels over the picture."""
    return tf.stack([tf.cos(light.direction), tf.sin(light.direction)])


def shadow_depth(coverage: tf.Tensor, light: LightParams, size: ImageSize, px_per_mm: tf.Tensor) -> tf.Tensor:
    """Depth of the shadow, [H, W] in about [0, 1], beside a caster of `coverage` [H, W] (shadow mapping).

    The caster is shifted by p and blurred by sz while it is interpolated from a quarter of the resolution.
    """
    shift = light.offset_mm * px_per_mm * light_direction(light)
    return blur_and_shift(coverage, size, light.softness_mm * px_per_mm, shift=shift).field


def apply_shadow(image: tf.Tensor, depth: tf.Tensor, light: LightParams) -> tf.Tensor:
    """[3, H, W] with a shadow of `depth` [H, W] on it."""
    return image * (1 - light.strength * tf.minimum(depth, 1))


def sample_illumination_grid(key: RandomStreams) -> tf.Tensor:
    """The uniform numbers [8, 8] behind uneven `illumination`."""
    return key.uniform([8, 8], Stream.ILLUMINATION)


def illumination(light: LightParams, values: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Relative illumination [H, W]: fall-off, vignetting, unevenness (by its `lattice`) and cast shadows."""
    x, y = centred_coordinates(GRID_NODES, size)
    along = light_direction(light)
    field = 1 + light.slope * (x * along[0] + y * along[1]) - light.vignette * (x * x + y * y)
    field *= 1 + light.unevenness * noise.simple_noise(values, (GRID_NODES, GRID_NODES)).field
    distance = x * tf.cos(light.cast_angle) + y * tf.sin(light.cast_angle) - light.cast_offset
    strength = light.cast_strength * tf.cast(light.cast, tf.float32)
    field *= 1 - strength * tf.sigmoid(distance / light.cast_softness)
    return noise.interpolate_grid(field, size).field


def slope_towards_light(slopes: tuple[tf.Tensor, tf.Tensor], light: LightParams) -> tf.Tensor:
    """How far [H, W] a surface with `slopes` (dH/dx and dH/dy) leans towards the light."""
    along = light_direction(light)
    return -(slopes[0] * along[0] + slopes[1] * along[1])


def shade_relief(colour: tf.Tensor, facing: tf.Tensor, light: LightParams) -> tf.Tensor:
    """Shade [3, H, W] by how it is `facing` [H, W] the light: Lambert's law and a highlight."""
    lit = tf.clip_by_value(1 + light.relief * facing, 0.3, 1.8)
    highlight = tf.clip_by_value(facing - 0.05, 0, 0.8)
    return colour * lit + light.gloss * highlight * highlight


def glass_reflection(light: LightParams, size: ImageSize) -> tf.Tensor:
    """How much [H, W] of the light comes from a pane: a veil and the soft-edged reflection of a window."""

    def reflect() -> tf.Tensor:
        x, y = centred_coordinates(2 * GRID_NODES, size)
        cosine, sine = tf.cos(light.glass_angle), tf.sin(light.glass_angle)
        across = x * cosine + y * sine - light.glass_offset
        along = y * cosine - x * sine
        pane = tf.sigmoid((light.glass_width - tf.abs(across)) / 0.02)
        bars = tf.sigmoid((tf.abs(tf.abs(along) - 0.2) - 0.02) / 0.01) * tf.sigmoid(
            (0.42 - tf.abs(along)) / 0.03
        )
        return light.glass_veil + light.glass_strength * noise.interpolate_grid(pane * bars, size).field

    return tf.cond(light.glass, reflect, lambda: tf.zeros(size))


def add_glass_reflection(image: tf.Tensor, reflected: tf.Tensor) -> tf.Tensor:
    """[3, H, W] behind a pane that reflects as much as `glass` says: its shadows are lifted."""
    return image + reflected * (0.97 - image)


def centred_coordinates(nodes: int, size: ImageSize) -> tuple[tf.Tensor, tf.Tensor]:
    """Coordinates x [1, n] and y [n, 1] from the centre of the picture, in units of its longer side.

    The lattice is a square over the longer side that begins where the picture does.
    """
    line = tf.linspace(-0.5, 0.5, nodes)
    down, across = ((1 - side / max(size)) / 2 for side in size)
    return line[None, :] + across, line[:, None] + down
