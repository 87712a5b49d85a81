"""Light: the leaf's shadow S(s, p, sz), uneven illumination, and a pane of glass (paper, "Rendering").

Shadows and illumination are smooth, so they are computed on a coarse grid and interpolated. These parameters
are sampled once per lighting pass: the passes over one leaf differ in nothing else.
"""

import math
from dataclasses import dataclass
from typing import Generic

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.filters import blur_and_shift
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability

GRID_NODES = 28
"""Nodes along each axis of the grid on which illumination is computed."""
UNEVENNESS_NODES = 8


@dataclass(frozen=True)
class LightParams(Generic[Value]):
    """One lighting of the scene."""

    strength: Value = interval(0.08, 0.6)
    """s: share of the light that the leaf's shadow removes."""
    direction: Value = interval(-math.pi, math.pi)
    offset_mm: Value = interval(0.0, 3.5)
    """p: displacement of the shadow, along `direction`."""
    softness_mm: Value = interval(0.35, 3.5)
    """sz: standard deviation of the shadow's edge."""
    slope: Value = interval(0.0, 0.4)
    """Fall-off of the light across the image."""
    vignette: Value = interval(0.0, 0.35)
    unevenness: Value = interval(0.0, 0.1)
    cast: Value = probability(0.35)
    """Something outside the image (a hand, the phone) shades part of it."""
    cast_strength: Value = interval(0.1, 0.55)
    cast_softness: Value = interval(0.01, 0.12)
    cast_offset: Value = interval(-0.45, 0.45)
    cast_angle: Value = interval(-math.pi, math.pi)
    relief: Value = interval(0.1, 0.9)
    """Strength of the shading by the leaf's normals."""
    gloss: Value = interval(0.0, 0.35)
    glass: Value = probability(0.16)
    glass_strength: Value = interval(0.05, 0.4)
    glass_angle: Value = interval(-math.pi, math.pi)
    glass_offset: Value = interval(-0.4, 0.4)
    glass_width: Value = interval(0.06, 0.35)
    glass_veil: Value = interval(0.0, 0.1)
    photographer: Value = probability(0.0)
    """The phone, and perhaps its holder's arm, shades a rectangle."""
    photographer_strength: Value = interval(0.1, 0.5)
    photographer_x: Value = interval(-0.5, 0.5)
    photographer_y: Value = interval(-0.5, 0.5)
    photographer_width: Value = interval(0.08, 0.3)
    """Half the width of the shadow; lengths are in units of the image's longer side."""
    photographer_length: Value = interval(0.15, 0.7)
    photographer_angle: Value = interval(-math.pi, math.pi)
    photographer_softness: Value = interval(0.008, 0.06)
    glare: Value = probability(0.0)
    """A lamp or window mirrored by glossy paper or plastic: a bright soft spot."""
    glare_strength: Value = interval(0.15, 0.8)
    glare_x: Value = interval(-0.5, 0.5)
    glare_y: Value = interval(-0.5, 0.5)
    glare_size: Value = interval(0.04, 0.25)
    glare_aspect: Value = interval(1.0, 3.0)
    glare_angle: Value = interval(-math.pi, math.pi)


def light_direction(light: LightParams[Scalar]) -> tf.Tensor:
    """Return the unit vector [2] along which the light travels over the image."""
    return tf.stack([tf.cos(light.direction), tf.sin(light.direction)])


def shadow_depth(
    coverage: tf.Tensor, light: LightParams[Scalar], size: ImageSize, px_per_mm: tf.Tensor
) -> tf.Tensor:
    """Return the depth [H, W] in about [0, 1] of the shadow of an object of `coverage` [H, W].

    Shadow mapping: the coverage is shifted by p and blurred by sz while it is interpolated from a quarter of
    the resolution.
    """
    shift_px = light.offset_mm * px_per_mm * light_direction(light)
    return blur_and_shift(coverage, size, light.softness_mm * px_per_mm, shift_px=shift_px).values


def apply_shadow(image: tf.Tensor, depth: tf.Tensor, light: LightParams[Scalar]) -> tf.Tensor:
    """Darken [3, H, W] by a shadow of `depth` [H, W]."""
    return image * (1 - light.strength * tf.minimum(depth, 1))


def slope_towards_light(slopes: tuple[tf.Tensor, tf.Tensor], light: LightParams[Scalar]) -> tf.Tensor:
    """Return how much [H, W] a surface of `slopes` (dH/dx, dH/dy) leans towards the light."""
    along = light_direction(light)
    return -(slopes[0] * along[0] + slopes[1] * along[1])


def shade_relief(colour: tf.Tensor, slope: tf.Tensor, light: LightParams[Scalar]) -> tf.Tensor:
    """Shade [3, H, W] by its `slope_towards_light` [H, W]: Lambert's law and a highlight."""
    diffuse = tf.clip_by_value(1 + light.relief * slope, 0.3, 1.8)
    highlight = tf.clip_by_value(slope - 0.05, 0, 0.8)
    return colour * diffuse + light.gloss * highlight * highlight


def illumination(light: LightParams[Scalar], grid: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return the relative illumination [H, W]: fall-off, vignetting, unevenness and cast shadows.

    `grid` [n, n] holds the uniform numbers of the unevenness.
    """
    x, y = centred_coordinates(GRID_NODES, size)
    along = light_direction(light)
    field = 1 + light.slope * (x * along[0] + y * along[1]) - light.vignette * (x * x + y * y)
    field *= 1 + light.unevenness * noise.simple_noise(grid, (GRID_NODES, GRID_NODES)).values
    distance = x * tf.cos(light.cast_angle) + y * tf.sin(light.cast_angle) - light.cast_offset
    strength = light.cast_strength * tf.cast(light.cast, tf.float32)
    field *= 1 - strength * tf.sigmoid(distance / light.cast_softness)
    return noise.interpolate_grid(field, size).values


def centred_coordinates(nodes: int, size: ImageSize) -> tuple[tf.Tensor, tf.Tensor]:
    """Return x [1, n] and y [n, 1] of a grid's nodes from the image centre, in units of its longer side.

    The grid is one that `noise.interpolate_grid` interpolates: a square over the longer side whose nodes 1
    and n - 2 lie on the image borders.
    """
    positions = (tf.range(nodes, dtype=tf.float32) - 1) / (nodes - 3)
    y, x = (positions - side / max(size) / 2 for side in size)
    return x[None, :], y[:, None]


def glass_reflection(light: LightParams[Scalar], size: ImageSize) -> tf.Tensor:
    """Return what a pane reflects [H, W]: a veil and the reflection of a window with soft edges."""

    def reflect() -> tf.Tensor:
        x, y = centred_coordinates(2 * GRID_NODES, size)
        cosine, sine = tf.cos(light.glass_angle), tf.sin(light.glass_angle)
        across = x * cosine + y * sine - light.glass_offset
        along = y * cosine - x * sine
        pane = tf.sigmoid((light.glass_width - tf.abs(across)) / 0.02)
        bars = tf.sigmoid((tf.abs(tf.abs(along) - 0.2) - 0.02) / 0.01) * tf.sigmoid(
            (0.42 - tf.abs(along)) / 0.03
        )
        return light.glass_veil + light.glass_strength * noise.interpolate_grid(pane * bars, size).values

    return tf.cond(light.glass, reflect, lambda: tf.zeros(size))


def add_glass_reflection(image: tf.Tensor, reflection: tf.Tensor) -> tf.Tensor:
    """Lift the shadows of [3, H, W] by what a pane of glass in front of it reflects [H, W]."""
    return image + reflection * (0.97 - image)


def photographer_shadow(light: LightParams[Scalar], size: ImageSize) -> tf.Tensor:
    """Return the relative illumination [H, W] in the photographer's shadow: a rectangle with soft edges."""

    def shade() -> tf.Tensor:
        across, along = _turned_coordinates(
            light.photographer_x, light.photographer_y, light.photographer_angle, size
        )
        inside = tf.sigmoid((light.photographer_width - tf.abs(across)) / light.photographer_softness)
        inside *= tf.sigmoid((light.photographer_length - tf.abs(along)) / light.photographer_softness)
        return 1 - light.photographer_strength * noise.interpolate_grid(inside, size).values

    return tf.cond(light.photographer, shade, lambda: tf.ones(size))


def glare_reflection(light: LightParams[Scalar], size: ImageSize) -> tf.Tensor:
    """Return the share [H, W] of white that a mirrored lamp adds: an elongated Gaussian spot."""

    def reflect() -> tf.Tensor:
        across, along = _turned_coordinates(light.glare_x, light.glare_y, light.glare_angle, size)
        square = across * across + (along / light.glare_aspect) ** 2
        spot = tf.exp(-square / (2 * light.glare_size * light.glare_size))
        return light.glare_strength * noise.interpolate_grid(spot, size).values

    return tf.cond(light.glare, reflect, lambda: tf.zeros(size))


def _turned_coordinates(
    x0: tf.Tensor, y0: tf.Tensor, angle: tf.Tensor, size: ImageSize
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the coordinates [n, n] of a grid's nodes about (`x0`, `y0`), turned by `angle`."""
    x, y = centred_coordinates(2 * GRID_NODES, size)
    cosine, sine = tf.cos(angle), tf.sin(angle)
    return (x - x0) * cosine + (y - y0) * sine, (y - y0) * cosine - (x - x0) * sine
