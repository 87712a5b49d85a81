"""Synthetic images of leaves on millimetre paper, rendered in-graph from a few dozen numbers.

Value contract: images are uint8 [H, W, 3] RGB 0..255 and masks uint8 [H, W] 0/1 outside of this package;
inside they are planar float32 [3, H, W] and [H, W] in [0, 1]. Lengths are in mm, areas in cm2. Every random
number comes from (seed, index): the same pair gives the same bytes in every dataset, and outside of one the
same but for the last bit of rounding.
"""

from pathlib import Path

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.geometry import ImageSize, require_shape
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges_toml import load_ranges
from laesi_tf.synthesis.renderer import render_lighting_passes, render_scene
from laesi_tf.synthesis.ruling_crops import CROP_NUMBERS, render_ruling_crop
from laesi_tf.synthesis.ruling_labels import CELL_PX
from laesi_tf.synthesis.scene import COMPONENTS, Ranges, Scene, sample_lighting_passes, sample_scene

SYNTHESIS_VERSION = 2
"""Changes whenever the image of a seed changes; data sets and runs store it."""

__all__ = [
    "COMPONENTS",
    "SYNTHESIS_VERSION",
    "Ranges",
    "Scene",
    "load_ranges",
    "render_scene",
    "sample_scene",
    "synthesise",
    "synthesise_passes",
    "synthesise_ruling_crop",
]


@tf.autograph.experimental.do_not_convert
def synthesise(
    seed: tf.Tensor | int,
    *,
    size: ImageSize = (224, 224),
    ranges: str | Path | Ranges = "rendering_2",
    index: tf.Tensor | int = 0,
    textures: tf.Tensor | None = None,
) -> dict[str, tf.Tensor]:
    """Render image `index` of `seed`, eagerly or inside tf.data.

    `size` is (height, width) in pixels; `ranges` a preset's name, a TOML file or Ranges. `textures` float32
    [N, T, T, 3], an array, tensor or variable relative to mean 1, blends photos of leaves into the colour C1
    (see `laesi_tf.data.leaf_textures`).

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's area
    centroid) and `tilt_deg` float32 [], `to_px` float32 [3, 3] (homography from sheet mm to pixels, without
    lens and bend), `kind` int32 [] (position of the leaf's kind in the ranges' `leaf`) and `index` int64 [].
    Raises InputError for unknown ranges, ValueError for an invalid size or textures of another shape.
    """
    _require_size(size)
    textures = _as_textures(textures)
    index = tf.cast(index, tf.int64)
    scene = sample_scene(seed, index, load_ranges(ranges))
    return render_scene(scene, size, textures=textures) | {"index": index}


@tf.autograph.experimental.do_not_convert
def synthesise_passes(
    seed: tf.Tensor | int,
    *,
    size: ImageSize = (224, 224),
    ranges: str | Path | Ranges = "rendering_2",
    first: tf.Tensor | int = 0,
    textures: tf.Tensor | None = None,
) -> dict[str, tf.Tensor]:
    """Render all lighting passes over one leaf, from image `first` on (paper, "Rendering").

    As `synthesise`, with an axis [ranges.lighting_passes] before the others: the same images for less, as
    leaf and paper are rendered once. `first` is a multiple of the number of passes.
    """
    _require_size(size)
    textures = _as_textures(textures)
    first = tf.cast(first, tf.int64)
    scenes = sample_lighting_passes(seed, first, load_ranges(ranges))
    samples = render_lighting_passes(scenes, size, textures=textures)
    stacked = {name: tf.stack([sample[name] for sample in samples]) for name in samples[0]}
    return stacked | {"index": first + tf.range(len(samples), dtype=tf.int64)}


@tf.autograph.experimental.do_not_convert
def synthesise_ruling_crop(
    seed: tf.Tensor | int,
    *,
    size: ImageSize = (192, 192),
    ranges: str | Path | Ranges = "rendering_2",
    index: tf.Tensor | int = 0,
    textures: tf.Tensor | None = None,
) -> dict[str, tf.Tensor]:
    """Render a crop, at any scale, of image `index` of `seed`: what the ruling network is trained on.

    Arguments and result are those of `synthesise`, and `ruling` float32 [h, w, 5], the labels of the cells
    of 16 x 16 pixels (`laesi_tf.synthesis.ruling_labels`). Raises ValueError for a size that is not a
    multiple of 16.
    """
    _require_size(size)
    if any(side % CELL_PX for side in size):
        raise ValueError(f"size is {size!r}; both sides must be multiples of {CELL_PX} pixels")
    textures = _as_textures(textures)
    index = tf.cast(index, tf.int64)
    scene = sample_scene(seed, index, load_ranges(ranges))
    numbers = RandomStreams(seed, index).uniform([CROP_NUMBERS], Stream.CROP)
    return render_ruling_crop(scene, size, numbers, textures=textures) | {"index": index}


def _as_textures(textures: tf.Tensor | None) -> tf.Tensor | None:
    """Convert textures to a tensor: an array cannot be indexed by tensors in graph mode."""
    if textures is None:
        return None
    converted = tf.convert_to_tensor(textures, tf.float32)
    require_shape("textures", converted, (None, None, None, 3))
    return converted


def _require_size(size: ImageSize) -> None:
    """Raise ValueError unless `size` is a pair of positive whole numbers."""
    if len(size) != 2 or not all(isinstance(side, int | np.integer) and side > 0 for side in size):
        raise ValueError(f"size is {size!r}; expected (height, width), both positive whole numbers of pixels")
