"""Repeated measurements and how they are told."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Repeated measurements: their median and interquartile range."""

    median: float
    iqr: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """The spread of `values`."""
        low, middle, high = np.percentile(values, [25, 50, 75])
        return cls(float(middle), float(high - low))

    @property
    def is_noise(self) -> bool:
        """Whether zero lies within the range."""
        return abs(self.median) <= self.iqr


def line(what: str, median: str, iqr: str = "") -> str:
    """A line of a benchmark's table."""
    return f"{what:42}{median:>10}{iqr:>10}".rstrip()
