"""The tf.data generator: pictures made on the fly, each a pure function of (seed, index, size, ranges).

The index is the only thing that moves, so the same picture comes out whatever the batch size, the number of
workers or the order. Training, validation and test read disjoint stretches of the index.
"""

import math
from pathlib import Path
from typing import Literal

import tensorflow as tf

from laesi_tf.synthesis import Ranges, load_ranges, synthesise, synthesise_passes

TRAIN_INDICES = (0, 2**40)
VALIDATION_INDICES = (2**40, 2**41)
TEST_INDICES = (2**41, 2**42)
"""Stretches [start, stop) of the index."""

TaskName = Literal["area", "mask", "both"]


def synthetic_samples(
    *,
    seed: int,
    size: tuple[int, int] = (224, 224),
    ranges: str | Path | Ranges = "rendering_2",
    start: int = 0,
    count: int | None = None,
    passes: int | None = None,
    textures: tf.Tensor | None = None,
    parallel: int = tf.data.AUTOTUNE,
) -> tf.data.Dataset:
    """Pictures `start`, `start` + 1, ... (`count` of them, or without end), as dicts of unbatched tensors.

    Keys: `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm`, `tilt_deg` float32 [],
    `to_px` float32 [3, 3], `kind` int32 [], `index` int64 []. `passes` overrides the ranges' lighting passes
    over one leaf: 1 makes every picture a new leaf. `parallel` is how many leaves are in work at once; a
    leaf is one task because it stays in a core's cache, which batches of them do not.
    """
    chosen = _resolve_ranges(ranges, passes)
    each = chosen.lighting_passes
    stop = start + count if count is not None else 2**62
    leaves = tf.data.Dataset.range(start // each, -(-stop // each))
    made = samples_of_leaves(
        leaves, seed=seed, size=size, ranges=chosen, textures=textures, parallel=parallel
    )
    return made.skip(start % each).take(stop - start)


def samples_of_leaves(
    leaves: tf.data.Dataset,
    *,
    seed: int,
    size: tuple[int, int] = (224, 224),
    ranges: str | Path | Ranges = "rendering_2",
    passes: int | None = None,
    textures: tf.Tensor | None = None,
    parallel: int = tf.data.AUTOTUNE,
) -> tf.data.Dataset:
    """The pictures of any stream of `leaves`, int64 []; the rest is as in `pictures`.

    Those of leaf i are the pictures i * passes, i * passes + 1, ... of the stream.
    """
    chosen = _resolve_ranges(ranges, passes)
    each = chosen.lighting_passes

    def lit(leaf: tf.Tensor) -> dict[str, tf.Tensor]:
        return synthesise_passes(seed, size=size, ranges=chosen, first=leaf * each, textures=textures)

    def single(leaf: tf.Tensor) -> dict[str, tf.Tensor]:
        return synthesise(seed, size=size, ranges=chosen, index=leaf, textures=textures)

    made = leaves.map(single if each == 1 else lit, num_parallel_calls=parallel, deterministic=True)
    return made if each == 1 else made.unbatch()


def _resolve_ranges(ranges: str | Path | Ranges, passes: int | None) -> Ranges:
    chosen = load_ranges(ranges)
    return chosen if passes is None else chosen.with_passes(passes)


def synthetic_batches(*, task: TaskName, batch_size: int, **options) -> tf.data.Dataset:
    """Batches of `pictures(**options)` as `batched` makes them."""
    return batch_samples(synthetic_samples(**options), task=task, batch_size=batch_size)


def batch_samples(stream: tf.data.Dataset, *, task: TaskName, batch_size: int) -> tf.data.Dataset:
    """Batches (image uint8 [B, H, W, 3], target) of a stream of pictures, made ahead while a model works.

    The target is that of `target`. The last batch of a bounded stream may be smaller.
    """
    return stream.map(lambda picture: make_example(picture, task)).batch(batch_size).prefetch(2)


def make_example(
    picture: dict[str, tf.Tensor], task: TaskName
) -> tuple[tf.Tensor, tf.Tensor | dict[str, tf.Tensor]]:
    """What a model of `task` learns from one picture: its image and its `target`."""
    return picture["image"], make_target(picture, task)


def make_target(picture: dict[str, tf.Tensor], task: TaskName) -> tf.Tensor | dict[str, tf.Tensor]:
    """What a model of `task` is to predict from `picture`.

    For "area" float32 [3]: area in cm2, pixels per mm at the leaf, and the leaf's share of the picture, NaN
    where the mask is empty, as that of a photo without one; for
    "mask" the mask uint8 [H, W]; for "both" a dict of the two under "area" and "mask".
    """
    share = tf.reduce_mean(tf.cast(picture["mask"], tf.float32))
    share = tf.where(share > 0, share, math.nan)
    area = tf.stack([picture["area_cm2"], picture["px_per_mm"], share])
    targets = {"area": area, "mask": picture["mask"]}
    return targets if task == "both" else targets[task]
