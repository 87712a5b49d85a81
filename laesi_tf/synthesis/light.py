"""Light: the leaf's shadow S(s, p, sz), uneven illumination, and a glass pane (paper, "Rendering").

Shadows and illumination are smooth, so they are made on a lattice a fraction of the picture's size and
interpolated. The numbers of this room are drawn once per lighting pass: the passes over one leaf differ in
nothing else.
"""

import math
from dataclasses import dataclass

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.frame import Size
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.ranges import Chance, Number


@dataclass(frozen=True)
class Light:
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
    cast: Number = Chance(0.35)
    """Something outside the frame (a hand, the phone) shades part of the picture."""
    cast_strength: Number = (0.1, 0.55)
    cast_softness: Number = (0.01, 0.12)
    cast_offset: Number = (-0.45, 0.45)
    cast_angle: Number = (-math.pi, math.pi)
    relief: Number = (0.1, 0.9)
    """Strength of the shading by the leaf's normals."""
    gloss: Number = (0.0, 0.35)
    glass: Number = Chance(0.16)
    glass_strength: Number = (0.05, 0.4)
    glass_angle: Number = (-math.pi, math.pi)
    glass_offset: Number = (-0.4, 0.4)
    glass_width: Number = (0.06, 0.35)
    glass_veil: Number = (0.0, 0.1)


LATTICE = 28
_COARSE = 4
"""Pixels a side of the blocks on which shadows are made."""


def direction(light: Light) -> tf.Tensor:
    """Unit vector [2] along which the light travels over the picture."""
    return tf.stack([tf.cos(light.direction), tf.sin(light.direction)])


def shadow(coverage: tf.Tensor, light: Light, size: Size, px_per_mm: tf.Tensor) -> tf.Tensor:
    """Depth of the shadow, [H, W] in about [0, 1], beside a caster of `coverage` [H, W] (shadow mapping).

    The caster is shifted by p and blurred by sz while it is interpolated from a quarter of the resolution.
    """
    shift = light.offset_mm * px_per_mm * direction(light)
    return soften(coverage, size, light.softness_mm * px_per_mm, shift=shift).field


def shaded(image: tf.Tensor, depth: tf.Tensor, light: Light) -> tf.Tensor:
    """[3, H, W] with a shadow of `depth` [H, W] on it."""
    return image * (1 - light.strength * tf.minimum(depth, 1))


def soften(
    coverage: tf.Tensor,
    size: Size,
    spread_px: tf.Tensor,
    *,
    shift: tf.Tensor | tuple[float, float] = (0.0, 0.0),
) -> noise.Factors:
    """Blur a field [H, W] that ends in zeros by a Gaussian of `spread_px` and shift it by (x, y) pixels."""
    coarse = _block_means(coverage, size)
    down = _smear(size[0], shift[1], spread_px)
    across = _smear(size[1], shift[0], spread_px)
    return noise.Factors(down @ coarse, across)


def _block_means(field: tf.Tensor, size: Size) -> tf.Tensor:
    """Means over blocks of `_COARSE` pixels a side. Sums along one axis at a time: avg_pool2d takes thrice
    as long on a single channel."""
    padded = tf.pad(field, [[0, -size[0] % _COARSE], [0, -size[1] % _COARSE]])
    rows = tf.reduce_sum(tf.reshape(padded, [-1, _COARSE, tf.shape(padded)[1]]), axis=1)
    blocks = tf.reduce_sum(tf.reshape(rows, [tf.shape(rows)[0], -1, _COARSE]), axis=2)
    return blocks * (1 / _COARSE**2)


def _smear(length: tf.Tensor | int, shift: tf.Tensor | float, spread_px: tf.Tensor) -> tf.Tensor:
    """Gaussian interpolation weights [length, length / 4]; the sum of a row is one well inside the frame."""
    nodes = (length + _COARSE - 1) // _COARSE
    pixels = tf.cast(tf.range(length), tf.float32) + 0.5 - shift
    centres = (tf.cast(tf.range(nodes), tf.float32) + 0.5) * _COARSE
    spread = tf.maximum(spread_px, 0.6 * _COARSE)
    distance = (pixels[:, None] - centres[None, :]) / spread
    return tf.exp(-0.5 * distance * distance) * (_COARSE / (spread * math.sqrt(2 * math.pi)))


def lattice(key: Key) -> tf.Tensor:
    """The uniform numbers [8, 8] behind uneven `illumination`."""
    return key.uniform([8, 8], Purpose.ILLUMINATION)


def illumination(light: Light, values: tf.Tensor, size: Size) -> tf.Tensor:
    """Relative illumination [H, W]: fall-off, vignetting, unevenness (by its `lattice`) and cast shadows."""
    x, y = _frame(LATTICE, size)
    along = direction(light)
    field = 1 + light.slope * (x * along[0] + y * along[1]) - light.vignette * (x * x + y * y)
    field *= 1 + light.unevenness * noise.simple(values, (LATTICE, LATTICE)).field
    distance = x * tf.cos(light.cast_angle) + y * tf.sin(light.cast_angle) - light.cast_offset
    strength = light.cast_strength * tf.cast(light.cast, tf.float32)
    field *= 1 - strength * tf.sigmoid(distance / light.cast_softness)
    return noise.upsample(field, size).field


def facing(slopes: tuple[tf.Tensor, tf.Tensor], light: Light) -> tf.Tensor:
    """How far [H, W] a surface with `slopes` (dH/dx and dH/dy) leans towards the light."""
    along = direction(light)
    return -(slopes[0] * along[0] + slopes[1] * along[1])


def relief(colour: tf.Tensor, facing: tf.Tensor, light: Light) -> tf.Tensor:
    """Shade [3, H, W] by how it is `facing` [H, W] the light: Lambert's law and a highlight."""
    lit = tf.clip_by_value(1 + light.relief * facing, 0.3, 1.8)
    highlight = tf.clip_by_value(facing - 0.05, 0, 0.8)
    return colour * lit + light.gloss * highlight * highlight


def glass(light: Light, size: Size) -> tf.Tensor:
    """How much [H, W] of the light comes from a pane: a veil and the soft-edged reflection of a window."""

    def reflect() -> tf.Tensor:
        x, y = _frame(2 * LATTICE, size)
        cosine, sine = tf.cos(light.glass_angle), tf.sin(light.glass_angle)
        across = x * cosine + y * sine - light.glass_offset
        along = y * cosine - x * sine
        pane = tf.sigmoid((light.glass_width - tf.abs(across)) / 0.02)
        bars = tf.sigmoid((tf.abs(tf.abs(along) - 0.2) - 0.02) / 0.01) * tf.sigmoid(
            (0.42 - tf.abs(along)) / 0.03
        )
        return light.glass_veil + light.glass_strength * noise.upsample(pane * bars, size).field

    return tf.cond(light.glass, reflect, lambda: tf.zeros(size))


def behind_glass(image: tf.Tensor, reflected: tf.Tensor) -> tf.Tensor:
    """[3, H, W] behind a pane that reflects as much as `glass` says: its shadows are lifted."""
    return image + reflected * (0.97 - image)


def _frame(nodes: int, size: Size) -> tuple[tf.Tensor, tf.Tensor]:
    """Coordinates x [1, n] and y [n, 1] from the centre of the picture, in units of its longer side.

    The lattice is a square over the longer side that begins where the picture does.
    """
    line = tf.linspace(-0.5, 0.5, nodes)
    down, across = ((1 - side / max(size)) / 2 for side in size)
    return line[None, :] + across, line[:, None] + down
