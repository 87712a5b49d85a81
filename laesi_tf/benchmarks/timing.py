"""Repeated measurements: median, interquartile range, and a row of a table."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class MedianIqr:
    """Median and interquartile range of repeated measurements."""

    median: float
    iqr: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "MedianIqr":
        """Summarise `values`."""
        low, middle, high = np.percentile(values, [25, 50, 75])
        return cls(float(middle), float(high - low))

    @property
    def is_noise(self) -> bool:
        """Whether the median is no further from zero than the interquartile range."""
        return abs(self.median) <= self.iqr


def format_row(name: str, *cells: str) -> str:
    """Format a row of a benchmark's table, such as a median and its interquartile range."""
    return f"{name:42}{''.join(f'{cell:>10}' for cell in cells)}".rstrip()


def consume(items: Iterable[object]) -> None:
    """Iterate over `items` and drop them."""
    for _ in items:
        pass
