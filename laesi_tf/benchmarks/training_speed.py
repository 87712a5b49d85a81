"""Measure training throughput on cached and on live scenes."""

import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from laesi_tf.benchmarks.synthesis_speed import BATCH_SIZE, WARMUP_STEPS, batch_scenes
from laesi_tf.benchmarks.timing import MedianIqr
from laesi_tf.synthesis import Ranges
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.loop import fit

CACHED_BATCHES = 8


def measure_training_speed(
    backbone: str,
    ranges: Ranges,
    *,
    weights: str,
    repeats: int,
    steps: int,
    seed: int,
    size: tuple[int, int],
) -> dict[str, Any]:
    """Measure the training loop's images per second on scenes in memory and on live ones, alternating.

    Returns `cached` and `live` (MedianIqr), `ratio` (live over cached, of medians) and `weights_origin`.
    """
    cached = list(batch_scenes(ranges, seed=seed, size=size, count=CACHED_BATCHES * BATCH_SIZE))
    live = batch_scenes(ranges, seed=seed, size=size, start=CACHED_BATCHES * BATCH_SIZE)
    rates: dict[str, list[float]] = {"cached": [], "live": []}
    sources = {"cached": itertools.cycle(cached), "live": iter(live)}
    # The loop opens its stream once more to calibrate batch normalisation after the last step.
    streams = iter([_alternate_sources(sources, rates, repeats, steps), cached])
    config = TrainConfig(
        backbone=backbone,
        size=size,
        batch_size=BATCH_SIZE,
        weights=weights,
        seed=seed,
        steps=2 * repeats * (WARMUP_STEPS + steps) + 1,
        validate_every=10**9,
        checkpoint_every=10**9,
    )
    with tempfile.TemporaryDirectory() as folder:
        result = fit(config, Path(folder), train=lambda _: next(streams), validation=cached[:1])
    summary = {name: MedianIqr.of(values) for name, values in rates.items()}
    ratio = summary["live"].median / summary["cached"].median
    return {**summary, "ratio": ratio, "weights_origin": result.metrics["weights_origin"]}


def _alternate_sources(
    sources: dict[str, Iterator[Any]], rates: dict[str, list[float]], repeats: int, steps: int
) -> Iterator[Any]:
    """Yield batches of each source alternately; append the images per second of each turn to `rates`.

    The loop trains on a batch before it asks for the next one, so both training and waiting are timed.
    """
    for _ in range(repeats):
        for name, source in sources.items():
            yield from itertools.islice(source, WARMUP_STEPS)
            started = time.perf_counter()
            yield from itertools.islice(source, steps)
            rates[name].append(steps * BATCH_SIZE / (time.perf_counter() - started))
    yield next(source)
