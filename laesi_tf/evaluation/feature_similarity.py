"""Compare two sets of images by the cosine of their features [N, D], which have unit length."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Features = NDArray[np.floating]


def nearest_cosines(features: Features, others: Features | None = None) -> Features:
    """Return for each image the cosine [N] to the most similar of `others`, or of its own set without it."""
    cosines = features @ (features if others is None else others).T
    if others is None:
        np.fill_diagonal(cosines, -np.inf)
    return cosines.max(axis=1)


def compare_sets(a: Features, b: Features) -> dict[str, Features]:
    """Return the nearest cosines between and within two sets; those within show what to expect between."""
    return {
        "a to b": nearest_cosines(a, b),
        "b to a": nearest_cosines(b, a),
        "within a": nearest_cosines(a),
        "within b": nearest_cosines(b),
    }


def summarise_scores(scores: Mapping[str, Features]) -> dict[str, float]:
    """Return the 10th percentile, median and 90th percentile of each of `scores`, as `a_to_b_p10` etc."""
    summary: dict[str, float] = {}
    for name, values in scores.items():
        key = name.replace(" ", "_")
        low, middle, high = np.percentile(values, [10, 50, 90])
        summary |= {f"{key}_p10": float(low), f"{key}_median": float(middle), f"{key}_p90": float(high)}
    return summary


def find_closest_pairs(cosines: Features, count: int) -> list[tuple[int, int, float]]:
    """Return the `count` largest of `cosines` [N, M] as (row, column, cosine), each row at most once.

    Otherwise one image that resembles many others could fill the list.
    """
    partners = cosines.argmax(axis=1)
    best = cosines[np.arange(len(cosines)), partners]
    order = np.argsort(-best, kind="stable")[:count]
    return [(int(row), int(partners[row]), float(best[row])) for row in order]
