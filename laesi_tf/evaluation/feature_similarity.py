"""Compare two sets of images by the cosine of their features."""

import numpy as np


def nearest_cosines(features: np.ndarray, others: np.ndarray | None = None) -> np.ndarray:
    """Cosine [N] of each picture to the most similar of `others`, or to the most similar other of its own."""
    cosines = features @ (features if others is None else others).T
    if others is None:
        np.fill_diagonal(cosines, -np.inf)
    return cosines.max(axis=1)


def find_closest_pairs(cosines: np.ndarray, count: int) -> list[tuple[int, int, float]]:
    """The `count` largest of `cosines` [N, M] as (row, column, cosine), each row in one pair at most.

    A picture that resembles many would otherwise be all that one sees.
    """
    partners = cosines.argmax(axis=1)
    best = cosines[np.arange(len(cosines)), partners]
    order = np.argsort(-best, kind="stable")[:count]
    return [(int(row), int(partners[row]), float(best[row])) for row in order]
