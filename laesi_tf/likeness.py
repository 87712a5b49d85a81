"""How alike pictures are, from their features [N, D] of unit length: scores, and charts of them."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.figure import Figure

from laesi_tf.errors import InputError
from laesi_tf.files import write_figure

_COLOURS = {"a": "tab:green", "b": "tab:orange"}
_NEIGHBOURS = 15
"""The size of the neighbourhoods that the map keeps together: umap-learn's own default."""


def nearest(features: np.ndarray, others: np.ndarray | None = None) -> np.ndarray:
    """Cosine [N] of each picture to the most similar of `others`, or to the most similar other of its own."""
    cosines = features @ (features if others is None else others).T
    if others is None:
        np.fill_diagonal(cosines, -np.inf)
    return cosines.max(axis=1)


def closest_pairs(cosines: np.ndarray, count: int) -> list[tuple[int, int, float]]:
    """The `count` largest of `cosines` [N, M] as (row, column, cosine), each row in one pair at most.

    A picture that resembles many would otherwise be all that one sees.
    """
    partners = cosines.argmax(axis=1)
    best = cosines[np.arange(len(cosines)), partners]
    order = np.argsort(-best, kind="stable")[:count]
    return [(int(row), int(partners[row]), float(best[row])) for row in order]


def chart_violins(path: Path, scores: Mapping[str, np.ndarray], *, title: str) -> None:
    """Write a PNG of the distributions of `scores`, one violin for each (paper, "Results")."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.violinplot(list(scores.values()), showmedians=True)
    axes.set_xticks(range(1, len(scores) + 1), list(scores))
    axes.set_ylabel("cosine to the nearest picture")
    axes.set_title(title, fontsize=8)
    write_figure(path, figure)


def require_umap() -> ModuleType:
    """The package umap. Raises InputError where umap-learn is not installed."""
    try:
        import umap
    except ImportError as error:
        raise InputError(
            "the map needs umap-learn; install it with pip install 'laesi_tf[similarity]'"
        ) from error
    return umap


def chart_umap(path: Path, features: Mapping[str, np.ndarray], *, title: str) -> None:
    """Write a PNG of both sets in the plane that UMAP (McInnes et al., 2018) finds for them together.

    Raises InputError where umap-learn is not installed.
    """
    umap = require_umap()
    together = np.concatenate(list(features.values()))
    neighbours = min(_NEIGHBOURS, len(together) - 1)
    # A spectral start needs more pictures than it has dimensions; so few are laid out from anywhere.
    start = "spectral" if len(together) > 2 * _NEIGHBOURS else "random"
    reducer = umap.UMAP(n_neighbors=neighbours, metric="cosine", init=start, random_state=0, n_jobs=1)
    places = np.split(reducer.fit_transform(together), [len(features["a"])])
    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.subplots()
    for (name, values), points in zip(features.items(), places, strict=True):
        label = f"{name} ({len(values)})"
        axes.scatter(points[:, 0], points[:, 1], s=8, alpha=0.6, color=_COLOURS[name], label=label)
    axes.legend()
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(title, fontsize=8)
    write_figure(path, figure)
