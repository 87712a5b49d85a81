"""Plot how similar two sets of images are: violins of cosines and a UMAP of the features."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.figure import Figure

from laesi_tf.common.atomic_files import write_figure
from laesi_tf.common.errors import InputError

_COLOURS = {"a": "tab:green", "b": "tab:orange"}
_NEIGHBOURS = 15
"""The size of the neighbourhoods that the map keeps together: umap-learn's own default."""


def plot_violins(path: Path, scores: Mapping[str, np.ndarray], *, title: str) -> None:
    """Write a PNG of the distributions of `scores`, one violin for each (paper, "Results")."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.violinplot(list(scores.values()), showmedians=True)
    axes.set_xticks(range(1, len(scores) + 1), list(scores))
    axes.set_ylabel("cosine to the nearest picture")
    axes.set_title(title, fontsize=8)
    write_figure(path, figure)


def import_umap() -> ModuleType:
    """The package umap. Raises InputError where umap-learn is not installed."""
    try:
        import umap
    except ImportError as error:
        raise InputError(
            "the map needs umap-learn; install it with pip install 'laesi_tf[similarity]'"
        ) from error
    return umap


def plot_umap(path: Path, features: Mapping[str, np.ndarray], *, title: str) -> None:
    """Write a PNG of both sets in the plane that UMAP (McInnes et al., 2018) finds for them together.

    Raises InputError where umap-learn is not installed.
    """
    umap = import_umap()
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
