"""Measure how fast scenes are rendered, and the memory that it takes."""

import itertools
import time
from collections.abc import Mapping

import tensorflow as tf

from laesi_tf.benchmarks.timing import MedianIqr, consume
from laesi_tf.common.hardware import peak_rss_mb
from laesi_tf.common.progress import progress_bar
from laesi_tf.data import synthetic
from laesi_tf.synthesis import Ranges
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import make_task

BATCH_SIZE = 32
WARMUP_STEPS = 6
"""Batches that are not timed, while the pipeline fills its buffers."""
SETTLED_IMAGES = 2000
"""Images after which memory should not grow any more."""


def batch_scenes(
    ranges: Ranges, *, seed: int, size: tuple[int, int], start: int = 0, count: int | None = None
) -> tf.data.Dataset:
    """Batch scenes as the training of an area network gets them."""
    return synthetic.synthetic_batches(
        make_target=make_task(TrainConfig(task="area")).make_target,
        batch_size=BATCH_SIZE,
        seed=seed,
        size=size,
        ranges=ranges,
        start=start,
        count=count,
    )


def measure_peak_memory(ranges: Ranges, *, images: int, seed: int, size: tuple[int, int]) -> dict[str, float]:
    """Measure this process's peak resident memory in MB, after all `images` and after the first 2,000.

    The peak never falls, so a leak shows as the difference. Returns `peak`, `settled` and `images`.
    """
    settled = None
    rendered = 0
    batches = batch_scenes(ranges, seed=seed, size=size, count=images)
    for batch, _ in progress_bar(batches, total=-(-images // BATCH_SIZE), desc="memory", unit="batch"):
        rendered += len(batch)
        if settled is None and rendered >= min(SETTLED_IMAGES, images):
            settled = peak_rss_mb()
    return {"peak": peak_rss_mb(), "settled": settled or peak_rss_mb(), "images": rendered}


def measure_throughput(
    variants: Mapping[str, Ranges], *, repeats: int, seed: int, size: tuple[int, int], batches: int = 16
) -> dict[str, MedianIqr]:
    """Measure the images per second of each variant of the ranges, while nothing else runs.

    The variants alternate, so that a drift of the machine affects all of them.
    """
    streams = {name: iter(batch_scenes(ranges, seed=seed, size=size)) for name, ranges in variants.items()}
    rates: dict[str, list[float]] = {name: [] for name in variants}
    for _ in progress_bar(range(repeats), desc="synthesis alone", unit="repeat"):
        for name, stream in streams.items():
            consume(itertools.islice(stream, WARMUP_STEPS))
            started = time.perf_counter()
            consume(itertools.islice(stream, batches))
            rates[name].append(batches * BATCH_SIZE / (time.perf_counter() - started))
    return {name: MedianIqr.of(values) for name, values in rates.items()}
