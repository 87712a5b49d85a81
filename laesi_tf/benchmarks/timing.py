"""Repeated measurements: median, interquartile range, and a row of a table."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from laesi_tf.synthesis import Ranges

# isort: split
import tensorflow as tf

from laesi_tf.data import synthetic


@dataclass(frozen=True)
class MedianIqr:
    """Repeated measurements: their median and interquartile range."""

    median: float
    iqr: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "MedianIqr":
        """The spread of `values`."""
        low, middle, high = np.percentile(values, [25, 50, 75])
        return cls(float(middle), float(high - low))

    @property
    def is_noise(self) -> bool:
        """Whether zero lies within the range."""
        return abs(self.median) <= self.iqr


def format_row(what: str, median: str, iqr: str = "") -> str:
    """A line of a benchmark's table."""
    return f"{what:42}{median:>10}{iqr:>10}".rstrip()


Size = tuple[int, int]

BATCH_SIZE = 32
WARMUP_STEPS = 6
"""Untimed steps after a turn begins: the stream before may still be filling its buffers."""


def stream_scenes(
    ranges: Ranges, seed: int, size: Size, *, start: int = 0, count: int | None = None
) -> tf.data.Dataset:
    """Batches (image, area_cm2) as training gets them."""
    return synthetic.synthetic_batches(
        task="area", batch_size=BATCH_SIZE, seed=seed, size=size, ranges=ranges, start=start, count=count
    )


def consume(items: Iterator[Any]) -> None:
    for _ in items:
        pass
