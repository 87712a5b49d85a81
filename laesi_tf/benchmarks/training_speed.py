"""Measure training throughput on cached and on live scenes."""

import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from laesi_tf.synthesis import Ranges
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.loop import fit

# isort: split
from laesi_tf.benchmarks.timing import BATCH_SIZE, WARMUP_STEPS, MedianIqr, Size, stream_scenes

_CACHED_BATCHES = 8


def measure_training_speed(
    backbone: str, ranges: Ranges, *, weights: str, repeats: int, steps: int, seed: int, size: Size
) -> dict[str, Any]:
    """Images per second of the training loop on pictures cached in memory and on live ones, in turns.

    Returns Spreads `cached` and `live`, and `ratio`, live over cached (of medians).
    """
    cached = list(stream_scenes(ranges, seed, size, count=_CACHED_BATCHES * BATCH_SIZE))
    live = stream_scenes(ranges, seed, size, start=_CACHED_BATCHES * BATCH_SIZE)
    rates: dict[str, list[float]] = {"cached": [], "live": []}
    turns = {"cached": itertools.cycle(cached), "live": iter(live)}
    # The loop asks for its stream once more when it calibrates batch normalisation after the last step.
    streams = iter([_alternate_sources(turns, rates, repeats, steps), cached])
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
    spreads = {name: MedianIqr.of(values) for name, values in rates.items()}
    ratio = spreads["live"].median / spreads["cached"].median
    return {**spreads, "ratio": ratio, "weights_origin": result.metrics["weights_origin"]}


def _alternate_sources(
    sources: dict[str, Iterator[Any]], rates: dict[str, list[float]], repeats: int, steps: int
) -> Iterator[Any]:
    """Batches of each source in turn; how fast they were asked for goes into `rates`.

    From one batch being handed out to the next being asked for, the loop trains on it; getting a batch is
    timed as well.
    """
    for _ in range(repeats):
        for name, source in sources.items():
            yield from itertools.islice(source, WARMUP_STEPS)
            begun = time.perf_counter()
            yield from itertools.islice(source, steps)
            rates[name].append(steps * BATCH_SIZE / (time.perf_counter() - begun))
    yield next(source)
