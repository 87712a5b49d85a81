"""The leaf's colours: C1 and C2 blended by gradient noise, browned edge, spots, veins (paper, section 3.2).

Fields are [H, W] and images [3, H, W], in image coordinates; lengths come in mm and are converted to pixels
by the scale of the view.
"""

from dataclasses import dataclass
from typing import Generic, NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.filters import blur_and_shift
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability

PALETTE = np.array(
    [
        [0.10, 0.20, 0.10],
        [0.16, 0.30, 0.12],
        [0.25, 0.40, 0.15],
        [0.36, 0.48, 0.22],
        [0.45, 0.52, 0.18],
        [0.62, 0.58, 0.20],
        [0.66, 0.47, 0.16],
        [0.52, 0.32, 0.13],
        [0.36, 0.22, 0.12],
        [0.24, 0.12, 0.10],
    ],
    np.float32,
)
"""Fresh green to autumn brown, sRGB."""
_CREAM = np.array([0.88, 0.86, 0.66], np.float32)
_CRIMSON = np.array([0.5, 0.1, 0.17], np.float32)
_BARK = np.array([0.4, 0.27, 0.18], np.float32)
BLEND_NODES = 16
FINE_NODES = 60


@dataclass(frozen=True)
class SurfaceParams(Generic[Value]):
    """One leaf's surface. `season` runs along PALETTE: 0 dark green, 0.5 yellow, 1 dark brown."""

    season: Value = interval(-0.55, 0.95)
    """Below zero counts as its distance from zero, so that two thirds of the leaves are green."""
    season_spread: Value = interval(0.0, 0.12)
    """Distance between C1 and C2 along the palette."""
    hue_red: Value = interval(-0.04, 0.04)
    hue_green: Value = interval(-0.05, 0.05)
    hue_blue: Value = interval(-0.04, 0.08)
    brightness: Value = interval(0.65, 1.35)
    blend_cells: Value = interval(4, 14)
    blend_sharpness: Value = interval(0.6, 3.0)
    vein_width_mm: Value = interval(0.7, 2.2)
    vein_contrast: Value = interval(-0.25, 0.5)
    """Above zero veins are lighter than the blade, below darker."""
    vein_jitter: Value = interval(0.01, 0.06)
    quilting: Value = interval(0.0, 1.0)
    """How much the blade bulges between its veins."""
    undulation: Value = interval(0.0, 1.0)
    undulation_cells: Value = interval(3, 8)
    mottle: Value = interval(0.0, 0.16)
    mottle_cells: Value = interval(20, 56)
    margin_browned: Value = probability(0.25)
    margin_depth: Value = interval(0.1, 0.6)
    spotted: Value = probability(0.15)
    spot_cells: Value = interval(24, 56)
    spot_threshold: Value = interval(0.6, 0.9)
    spot_season: Value = interval(0.55, 1.0)
    texture_share: Value = interval(0.4, 1.0)
    """Share of a photo texture in C1, if textures are given."""
    margin_pale: Value = probability(0.0)
    """The leaf is variegated: its margin is cream."""
    pale_depth: Value = interval(0.4, 0.95)
    pale_mm: Value = interval(0.8, 3.5)
    """Standard deviation of the blur that tells margin from blade."""
    petiole_red: Value = probability(0.0)
    """Petiole and veins are red or brown, whatever the blade's colour."""
    red_depth: Value = interval(0.4, 0.95)
    red_hue: Value = interval(0.0, 1.0)
    """0 crimson, 1 the brown of bark."""


class SurfaceNoiseGrids(NamedTuple):
    """Uniform numbers from which the fields of a leaf's surface are interpolated."""

    blend: tf.Tensor
    mottle: tf.Tensor
    spots: tf.Tensor
    undulation: tf.Tensor


def cut_leaf_texture(textures: tf.Tensor, numbers: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return a random square of one of `textures` [N, T, T, 3] at `size`: relief [3, H, W] around mean 1."""
    count, side = tf.shape(textures)[0], textures.shape[1]
    texture = textures[tf.cast(numbers[0] * tf.cast(count, tf.float32), tf.int32)]
    crop = tf.cast((0.5 + 0.5 * numbers[1]) * side, tf.int32)
    corner = tf.cast(numbers[2:] * tf.cast(side - crop, tf.float32), tf.int32)
    square = tf.image.resize(texture[corner[0] : corner[0] + crop, corner[1] : corner[1] + crop], size)
    return tf.transpose(square, [2, 0, 1])


def leaf_colour(
    coverage: tf.Tensor,
    veins: tf.Tensor | None,
    grids: SurfaceNoiseGrids,
    texture: tf.Tensor | None,
    surface: SurfaceParams[Scalar],
    px_per_mm: tf.Tensor,
    components: tuple[str, ...],
) -> tf.Tensor:
    """Return the colours [3, H, W] of the leaf's surface, from coverage by the leaf and its veins [H, W]."""
    size = (coverage.shape[0], coverage.shape[1])
    blend = colour_blend_noise(surface, grids.blend, size)
    mottle = mottle_noise(surface, grids.mottle, size)
    colour = blend_leaf_colours(surface, blend, mottle, texture)
    if "browned_margin" in components:
        inwardness = tf.cond(
            surface.margin_browned,
            lambda: blur_and_shift(coverage, size, 3.0 * px_per_mm).values,
            lambda: tf.ones_like(coverage),
        )
        colour = apply_browned_edge(colour, surface, inwardness)
    if "pale_margin" in components:
        colour = tf.cond(
            surface.margin_pale,
            lambda: apply_pale_margin(
                colour, surface, blur_and_shift(coverage, size, surface.pale_mm * px_per_mm).values
            ),
            lambda: colour,
        )
    if "spots" in components:
        colour = apply_spots(colour, surface, spot_coverage(surface, grids.spots, size))
    return colour if veins is None else apply_vein_colour(colour, surface, veins, components)


def colour_blend_noise(surface: SurfaceParams[Scalar], gradients: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return the gradient noise [H, W], about [-1, 1], by which C1 and C2 are blended."""
    return noise.gradient_noise(gradients * 2 - 1, size, cells=surface.blend_cells).values


def mottle_noise(surface: SurfaceParams[Scalar], values: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return the fine mottling [H, W], about [-1, 1]."""
    return noise.simple_noise(values, size, cells=surface.mottle_cells).values


def blend_leaf_colours(
    surface: SurfaceParams[Scalar], blend: tf.Tensor, mottle: tf.Tensor, texture: tf.Tensor | None
) -> tf.Tensor:
    """Return the texture T [3, H, W] before veins: C1 and C2, blended and mottled.

    `blend` [H, W] and `mottle` [H, W] come from `colour_blend_noise` and `mottle_noise`. `texture` [3, H, W],
    where given, is a photo's relief around mean 1 that multiplies C1.
    """
    first, second = base_colours(surface)
    share = tf.clip_by_value(0.5 + surface.blend_sharpness * blend, 0, 1)
    if texture is not None:
        first = first * (1 + surface.texture_share * (texture - 1))
    return (first + share * (second - first)) * (1 + surface.mottle * mottle)


def base_colours(surface: SurfaceParams[Scalar]) -> tuple[tf.Tensor, tf.Tensor]:
    """Return C1 and C2, [3, 1, 1] each."""
    season = tf.abs(surface.season)
    jitter = tf.stack([surface.hue_red, surface.hue_green, surface.hue_blue])[:, None, None]
    first = (season_colour(season) + jitter) * surface.brightness
    second = (season_colour(season + surface.season_spread) + jitter) * surface.brightness
    return tf.clip_by_value(first, 0.02, 0.95), tf.clip_by_value(second, 0.02, 0.95)


def season_colour(season: tf.Tensor) -> tf.Tensor:
    """Return the colour [3, 1, 1] at `season` in [0, 1] of PALETTE, linearly interpolated."""
    position = tf.clip_by_value(season, 0, 1) * (len(PALETTE) - 1)
    weights = tf.maximum(1 - tf.abs(position - tf.range(len(PALETTE), dtype=tf.float32)), 0)
    return tf.linalg.matvec(tf.constant(PALETTE), weights, transpose_a=True)[:, None, None]


def apply_browned_edge(colour: tf.Tensor, surface: SurfaceParams[Scalar], inwardness: tf.Tensor) -> tf.Tensor:
    """Brown [3, H, W] towards the leaf's edge.

    `inwardness` [H, W] is the blurred coverage, about 0.5 at the edge; from 1 up nothing is browned.
    """
    edge = tf.clip_by_value(2 - 2 * inwardness, 0, 1)
    return colour + surface.margin_depth * edge * edge * (season_colour(tf.constant(0.8)) - colour)


def apply_pale_margin(colour: tf.Tensor, surface: SurfaceParams[Scalar], inwardness: tf.Tensor) -> tf.Tensor:
    """Bleach [3, H, W] towards the leaf's edge; `inwardness` [H, W] as in `apply_browned_edge`."""
    edge = tf.clip_by_value((0.85 - inwardness) * 8, 0, 1)
    return colour + surface.pale_depth * edge * (tf.constant(_CREAM)[:, None, None] - colour)


def spot_coverage(surface: SurfaceParams[Scalar], values: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return the coverage [H, W] in [0, 1] by brown spots and patches; zero on leaves without spots."""

    def spots() -> tf.Tensor:
        field = noise.simple_noise(values, size, cells=surface.spot_cells).values
        return tf.clip_by_value((field - surface.spot_threshold) * 8, 0, 0.9)

    return tf.cond(surface.spotted, spots, lambda: tf.zeros([size[0], size[1]]))


def apply_spots(colour: tf.Tensor, surface: SurfaceParams[Scalar], coverage: tf.Tensor) -> tf.Tensor:
    """Paint brown spots of `coverage` [H, W] on [3, H, W]."""
    return colour + coverage * (season_colour(surface.spot_season) - colour)


def apply_vein_colour(
    colour: tf.Tensor, surface: SurfaceParams[Scalar], coverage: tf.Tensor, components: tuple[str, ...]
) -> tf.Tensor:
    """Lighten, darken or redden [3, H, W] by the veins' coverage V_e [H, W]."""
    pale = tf.where(surface.vein_contrast > 0, tf.constant([0.72, 0.74, 0.45]), 0.0)
    depth = tf.abs(surface.vein_contrast)
    if "red_petiole" in components:
        red = tf.constant(_CRIMSON) + surface.red_hue * tf.constant(_BARK - _CRIMSON)
        pale = tf.where(surface.petiole_red, red, pale)
        depth = tf.where(surface.petiole_red, surface.red_depth, depth)
    return colour + depth * coverage * (pale[:, None, None] - colour)
