"""The leaf's surface: colours C1 and C2 blended by gradient noise, veins, relief, spots (paper, section 3.2).

Fields are [H, W] and images [3, H, W], in picture coordinates; lengths come in millimetres and are turned to
pixels by the view's scale.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Number, Probability

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


@dataclass(frozen=True)
class SurfaceParams:
    """One leaf's surface. `season` runs along PALETTE: 0 dark green, 0.5 yellow, 1 dark brown."""

    season: Number = (-0.55, 0.95)
    """Below zero counts as its distance from zero, so that two thirds of the leaves are green."""
    season_spread: Number = (0.0, 0.12)
    """Distance between C1 and C2 along the palette."""
    hue_red: Number = (-0.04, 0.04)
    hue_green: Number = (-0.05, 0.05)
    hue_blue: Number = (-0.04, 0.08)
    brightness: Number = (0.65, 1.35)
    blend_cells: Number = (4, 14)
    blend_sharpness: Number = (0.6, 3.0)
    vein_width_mm: Number = (0.7, 2.2)
    vein_contrast: Number = (-0.25, 0.5)
    """Above zero veins are lighter than the blade, below darker."""
    vein_jitter: Number = (0.01, 0.06)
    quilting: Number = (0.0, 1.0)
    """How far the blade bulges between its veins."""
    undulation: Number = (0.0, 1.0)
    undulation_cells: Number = (3, 8)
    mottle: Number = (0.0, 0.16)
    mottle_cells: Number = (20, 56)
    margin_browned: Number = Probability(0.25)
    margin_depth: Number = (0.1, 0.6)
    spotted: Number = Probability(0.15)
    spot_cells: Number = (24, 56)
    spot_threshold: Number = (0.6, 0.9)
    spot_season: Number = (0.55, 1.0)
    texture_share: Number = (0.4, 1.0)
    """Share of a photographed texture in C1, where the user names a folder of them."""


_BLEND_NODES = 16
_FINE_NODES = 60


def base_colours(surface: SurfaceParams) -> tuple[tf.Tensor, tf.Tensor]:
    """C1 and C2 [3, 1, 1]."""
    season = tf.abs(surface.season)
    jitter = tf.stack([surface.hue_red, surface.hue_green, surface.hue_blue])[:, None, None]
    first = (season_colour(season) + jitter) * surface.brightness
    second = (season_colour(season + surface.season_spread) + jitter) * surface.brightness
    return tf.clip_by_value(first, 0.02, 0.95), tf.clip_by_value(second, 0.02, 0.95)


def season_colour(season: tf.Tensor) -> tf.Tensor:
    """Colour [3, 1, 1] at `season` in [0, 1] of PALETTE, linearly interpolated."""
    position = tf.clip_by_value(season, 0, 1) * (len(PALETTE) - 1)
    weights = tf.maximum(1 - tf.abs(position - tf.range(len(PALETTE), dtype=tf.float32)), 0)
    return tf.linalg.matvec(tf.constant(PALETTE), weights, transpose_a=True)[:, None, None]


class SurfaceNoiseGrids(NamedTuple):
    """Uniform numbers behind a leaf's fields, named after the functions that make them of these."""

    blend: tf.Tensor
    mottle: tf.Tensor
    spots: tf.Tensor
    undulation: tf.Tensor


def sample_surface_noise_grids(key: RandomStreams) -> SurfaceNoiseGrids:
    """The numbers of one leaf's fields."""
    return SurfaceNoiseGrids(
        blend=key.uniform([2, _BLEND_NODES, _BLEND_NODES], Stream.SURFACE),
        mottle=key.uniform([_FINE_NODES, _FINE_NODES], Stream.MOTTLE),
        spots=key.uniform([_FINE_NODES, _FINE_NODES], Stream.SPOTS),
        undulation=key.uniform([2, noise.VORONOI_CELLS + 2, noise.VORONOI_CELLS + 2], Stream.SURFACE_VORONOI),
    )


def colour_blend_noise(surface: SurfaceParams, gradients: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Gradient noise [H, W], about [-1, 1], by which C1 and C2 are blended."""
    return noise.gradient_noise(gradients * 2 - 1, size, cells=surface.blend_cells).field


def mottle_noise(surface: SurfaceParams, values: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Fine mottling [H, W], about [-1, 1]."""
    return noise.simple_noise(values, size, cells=surface.mottle_cells).field


def spot_coverage(surface: SurfaceParams, values: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Cover [H, W] in [0, 1] by brown spots and patches, on leaves that have them."""

    def stains() -> tf.Tensor:
        field = noise.simple_noise(values, size, cells=surface.spot_cells).field
        return tf.clip_by_value((field - surface.spot_threshold) * 8, 0, 0.9)

    return tf.cond(surface.spotted, stains, lambda: tf.zeros([size[0], size[1]]))


def blend_leaf_colours(
    surface: SurfaceParams, blended: tf.Tensor, mottled: tf.Tensor, texture: tf.Tensor | None
) -> tf.Tensor:
    """The texture T [3, H, W] before veins: C1 and C2 blended by `blend`, times `mottle`.

    `texture` [3, H, W], where given, is a photograph's relief around mean 1 that multiplies C1.
    """
    first, second = base_colours(surface)
    share = tf.clip_by_value(0.5 + surface.blend_sharpness * blended, 0, 1)
    if texture is not None:
        first = first * (1 + surface.texture_share * (texture - 1))
    return (first + share * (second - first)) * (1 + surface.mottle * mottled)


def apply_spots(colour: tf.Tensor, surface: SurfaceParams, cover: tf.Tensor) -> tf.Tensor:
    """[3, H, W] with brown spots that `cover` [H, W] of it."""
    return colour + cover * (season_colour(surface.spot_season) - colour)


def undulation_height(surface: SurfaceParams, jitter: tf.Tensor, size: ImageSize) -> noise.SeparableField:
    """Voronoi displacement of the blade's height, about [-1, 1] (paper: vertex displacement)."""
    return noise.voronoi_noise(jitter, size, cells=surface.undulation_cells) * surface.undulation


def height_slopes(height_mm: tf.Tensor, px_per_mm: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Slopes dH/dx and dH/dy [H, W] of a height map in mm: the normal is (-dH/dx, -dH/dy, 1)."""
    right = tf.pad(height_mm[:, 1:] - height_mm[:, :-1], [[0, 0], [0, 1]])
    below = tf.pad(height_mm[1:] - height_mm[:-1], [[0, 1], [0, 0]])
    return right * px_per_mm, below * px_per_mm


def apply_vein_colour(colour: tf.Tensor, surface: SurfaceParams, coverage: tf.Tensor) -> tf.Tensor:
    """Lighten or darken [3, H, W] where veins V_e [H, W] run."""
    pale = tf.where(surface.vein_contrast > 0, tf.constant([0.72, 0.74, 0.45]), 0.0)[:, None, None]
    return colour + tf.abs(surface.vein_contrast) * coverage * (pale - colour)


def apply_browned_edge(colour: tf.Tensor, surface: SurfaceParams, inwardness: tf.Tensor) -> tf.Tensor:
    """Brown [3, H, W] towards the margin; `inwardness` [H, W] is the softened coverage, about 0.5 there.

    From 1 up nothing is browned.
    """
    edge = tf.clip_by_value(2 - 2 * inwardness, 0, 1)
    return colour + surface.margin_depth * edge * edge * (season_colour(tf.constant(0.8)) - colour)


def sample_leaf_texture(textures: tf.Tensor, key: RandomStreams, size: ImageSize) -> tf.Tensor:
    """Relief [3, H, W] around mean 1 from one of `textures` [N, T, T, 3], a random square of it."""
    random = key.uniform([4], Stream.TEXTURE)
    count, side = tf.shape(textures)[0], textures.shape[1]
    chosen = textures[tf.cast(random[0] * tf.cast(count, tf.float32), tf.int32)]
    crop = tf.cast((0.5 + 0.5 * random[1]) * side, tf.int32)
    corner = tf.cast(random[2:] * tf.cast(side - crop, tf.float32), tf.int32)
    square = tf.image.resize(chosen[corner[0] : corner[0] + crop, corner[1] : corner[1] + crop], size)
    return tf.transpose(square, [2, 0, 1])
