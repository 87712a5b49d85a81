"""Pictures of leaves on millimetre paper, made in-graph from a few dozen numbers.

Value contract: images are uint8 [H, W, 3] RGB 0..255 and masks uint8 [H, W] 0/1 outside this package; inside
it they are planar float32 [3, H, W] and [H, W] in [0, 1]. Lengths are millimetres, areas cm2. Every random
number comes from (seed, index): the same pair gives the same bytes from any dataset, and outside of one
the same but for the last bit of rounding.
"""

from pathlib import Path

import tensorflow as tf

from laesi_tf.synthesis.ranges_toml import load_ranges
from laesi_tf.synthesis.renderer import render_lighting_passes, render_scene
from laesi_tf.synthesis.scene import COMPONENTS, Ranges, Scene, sample_lighting_passes, sample_scene

__all__ = [
    "COMPONENTS",
    "Ranges",
    "Scene",
    "load_ranges",
    "render",
    "sample",
    "synthesise",
    "synthesise_passes",
]


@tf.autograph.experimental.do_not_convert
def synthesise(
    seed: tf.Tensor | int,
    *,
    size: tuple[int, int] = (224, 224),
    ranges: str | Path | Ranges = "rendering_2",
    index: tf.Tensor | int = 0,
    textures: tf.Tensor | None = None,
) -> dict[str, tf.Tensor]:
    """Make picture `index` of the stream `seed`, eagerly or inside tf.data.

    `size` is (height, width) in pixels; `ranges` a preset's name, a TOML file or Ranges. `textures`
    [N, T, T, 3], relative to mean 1, blends photographed leaves into C1 (see `laesi_tf.data.leaf_textures`).

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's
    centroid) and `tilt_deg` float32 [], `to_px` float32 [3, 3] (homography from sheet mm to pixels), `kind`
    int32 [] (place of the kind of leaf in the ranges' `leaf`) and `index` int64 []. Raises InputError for
    unknown ranges.
    """
    chosen = load_ranges(ranges)
    index = tf.cast(index, tf.int64)
    return render_scene(sample_scene(seed, index, chosen), size, chosen, textures=textures) | {"index": index}


@tf.autograph.experimental.do_not_convert
def synthesise_passes(
    seed: tf.Tensor | int,
    *,
    size: tuple[int, int] = (224, 224),
    ranges: str | Path | Ranges = "rendering_2",
    first: tf.Tensor | int = 0,
    textures: tf.Tensor | None = None,
) -> dict[str, tf.Tensor]:
    """Make the pictures of all lighting passes over one leaf, from picture `first` on (paper, "Rendering").

    As `synthesise`, with an axis [ranges.lighting_passes] before the others: the same pictures for less, as
    leaf and paper are made once. `first` is a multiple of the passes.
    """
    chosen = load_ranges(ranges)
    first = tf.cast(first, tf.int64)
    pictures = render_lighting_passes(
        sample_lighting_passes(seed, first, chosen), size, chosen, textures=textures
    )
    made = {name: tf.stack([picture[name] for picture in pictures]) for name in pictures[0]}
    return made | {"index": first + tf.range(len(pictures), dtype=tf.int64)}
