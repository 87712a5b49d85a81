"""Render samples inside tf.data: each is a pure function of (seed, index, size, ranges).

Only the index changes along a stream, so a sample does not depend on batch size, number of threads or order.
Training, validation and test use disjoint intervals of the index.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import tensorflow as tf

from laesi_tf.data.sample import Sample
from laesi_tf.synthesis import Ranges, load_ranges, synthesise, synthesise_passes

TRAIN_INDICES = (0, 2**40)
"""Interval [start, stop) of the index for training."""
VALIDATION_INDICES = (2**40, 2**41)
TEST_INDICES = (2**41, 2**42)

MakeTarget = Callable[[Sample], tf.Tensor]
"""What a network is trained to predict for a sample; `make_target` of a task in `laesi_tf.training.tasks`."""


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
    render: Callable[..., Sample] = synthesise,
) -> tf.data.Dataset:
    """Render samples `start`, `start` + 1, ...: `count` of them, or an endless stream.

    `size` is (height, width) in pixels. `ranges` is the name of a preset, a TOML file, or Ranges. `passes`
    overrides the number of lighting passes over a leaf: with 1, every sample shows a new leaf. `textures` is
    as for `laesi_tf.synthesis.synthesise`. `parallel` leaves are rendered at once; a leaf is one unit of work
    because it fits in the cache of a core, which a batch does not. `render` replaces `synthesise` where
    `passes` is 1. See `laesi_tf.data.sample` for the keys.
    """
    chosen = _resolve_ranges(ranges, passes)
    passes = chosen.lighting_passes
    stop = start + count if count is not None else 2**62
    leaves = tf.data.Dataset.range(start // passes, -(-stop // passes))
    samples = samples_of_leaves(
        leaves, seed=seed, size=size, ranges=chosen, textures=textures, parallel=parallel, render=render
    )
    return samples.skip(start % passes).take(stop - start)


def samples_of_leaves(
    leaves: tf.data.Dataset,
    *,
    seed: int,
    size: tuple[int, int] = (224, 224),
    ranges: str | Path | Ranges = "rendering_2",
    passes: int | None = None,
    textures: tf.Tensor | None = None,
    parallel: int = tf.data.AUTOTUNE,
    render: Callable[..., Sample] = synthesise,
) -> tf.data.Dataset:
    """Render the samples of `leaves`, a dataset of indices int64 []; all else is as in `synthetic_samples`.

    Leaf i has the samples i * passes, ..., (i + 1) * passes - 1 of the stream.
    """
    chosen = _resolve_ranges(ranges, passes)
    passes = chosen.lighting_passes

    def render_leaf(leaf: tf.Tensor) -> Sample:
        if passes == 1:
            return render(seed, size=size, ranges=chosen, index=leaf, textures=textures)
        return synthesise_passes(seed, size=size, ranges=chosen, first=leaf * passes, textures=textures)

    samples = leaves.map(render_leaf, num_parallel_calls=parallel, deterministic=True)
    return samples if passes == 1 else samples.unbatch()


def synthetic_batches(*, make_target: MakeTarget, batch_size: int, **options: Any) -> tf.data.Dataset:
    """Batch `synthetic_samples(**options)` as `batch_samples` does."""
    return batch_samples(synthetic_samples(**options), make_target=make_target, batch_size=batch_size)


def batch_samples(samples: tf.data.Dataset, *, make_target: MakeTarget, batch_size: int) -> tf.data.Dataset:
    """Turn samples into batches (image uint8 [B, H, W, 3], target [B, ...]), two of them in advance.

    The last batch of a bounded stream may be smaller.
    """
    examples = samples.map(lambda sample: (sample["image"], make_target(sample)))
    return examples.batch(batch_size).prefetch(2)


def _resolve_ranges(ranges: str | Path | Ranges, passes: int | None) -> Ranges:
    loaded = load_ranges(ranges)
    return loaded if passes is None else loaded.with_passes(passes)
