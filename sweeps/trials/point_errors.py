"""Errors of points that were tried with several seeds."""

from collections.abc import Iterable

import numpy as np


def geometric_means(errors: Iterable[tuple[int, float]]) -> dict[int, float]:
    """Return the geometric mean of the errors (number, MRE) of each point, by its number."""
    logs: dict[int, list[float]] = {}
    for number, mre in errors:
        logs.setdefault(number, []).append(np.log(mre))
    return {number: float(np.exp(np.mean(values))) for number, values in logs.items()}
