"""The sheet: its colour, noise and wear, crease and edges (paper, section 3.1)."""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.random_streams import RandomStreams, Stream

_GRADIENT_NODES = 16
_SIMPLE_NODES = 30


def sheet_colour(paper: PaperParams) -> tf.Tensor:
    """Base colour of the sheet [3, 1, 1] in [0, 1]."""
    saturation = paper.saturation * tf.cast(paper.tinted, tf.float32) + 0.02
    return hsv_to_rgb(paper.hue, saturation)[:, None, None] * paper.brightness


class SheetNoiseGrids(NamedTuple):
    """Uniform numbers behind a sheet's wear: `gradients`, `values` (of the blend, of the ink) and Voronoi
    `jitter`, each [2, n, n]."""

    gradients: tf.Tensor
    values: tf.Tensor
    jitter: tf.Tensor


def sample_sheet_noise_grids(key: RandomStreams) -> SheetNoiseGrids:
    """The numbers of one sheet's `wear`."""
    return SheetNoiseGrids(
        gradients=key.uniform([2, _GRADIENT_NODES, _GRADIENT_NODES], Stream.PAPER_GRADIENT),
        values=key.uniform([2, _SIMPLE_NODES, _SIMPLE_NODES], Stream.PAPER),
        jitter=key.uniform([2, noise.VORONOI_CELLS + 2, noise.VORONOI_CELLS + 2], Stream.PAPER_VORONOI),
    )


def paper_noise(paper: PaperParams, drawn: SheetNoiseGrids, size: ImageSize) -> tuple[tf.Tensor, tf.Tensor]:
    """The blended noise L of the paper's section 3.1, and the ink's relative strength: both [H, W]."""
    fields = (
        noise.gradient_noise(drawn.gradients * 2 - 1, size, cells=paper.gradient_cells),
        noise.voronoi_noise(drawn.jitter, size, cells=paper.voronoi_cells),
        noise.simple_noise(drawn.values[0], size, cells=paper.simple_cells),
    )
    weights = (paper.gradient_weight, paper.voronoi_weight, paper.simple_weight)
    strength = noise.interpolate_grid(drawn.values[1], size, cells=paper.simple_cells)
    return noise.blend_noises(weights, fields).field, 1 - paper.print_wear * strength.field


def crease_shading(paper: PaperParams, x_mm: tf.Tensor, y_mm: tf.Tensor, fov_mm: tf.Tensor) -> tf.Tensor:
    """Relief shading [H, W] of a fold across the sheet: one flank lit, the other in shade."""
    cosine, sine = tf.cos(paper.crease_angle), tf.sin(paper.crease_angle)
    distance = (x_mm * cosine + (y_mm * sine - paper.crease_offset * fov_mm)) / 1.2
    return paper.crease_depth * 2 * distance * tf.exp(-distance * distance)


def distance_to_sheet_edge(
    paper: PaperParams, leaf: tf.Tensor, x_mm: tf.Tensor, y_mm: tf.Tensor
) -> tf.Tensor:
    """Distance [H, W] in mm from the nearest side of the sheet that holds `leaf` [n, 2]; negative off it."""
    low = tf.reduce_min(leaf, axis=0) - tf.stack([paper.left, paper.top])
    high = tf.reduce_max(leaf, axis=0) + tf.stack([paper.right, paper.bottom])
    middle, half = (low + high) / 2, (high - low) / 2
    return tf.minimum(half[0] - tf.abs(x_mm - middle[0]), half[1] - tf.abs(y_mm - middle[1]))
