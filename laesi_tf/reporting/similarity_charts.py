"""Draw how similar two sets of images are: violins of cosines, a map of the features, the closest pairs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from laesi_tf.common.atomic_files import write_figure
from laesi_tf.common.errors import InputError
from laesi_tf.reporting.captions import add_caption, make_contact_sheet
from laesi_tf.reporting.overlay import write_png

_COLOURS = {"a": "tab:green", "b": "tab:orange"}
_NEIGHBOURS = 15
"""Size of the neighbourhoods that the map preserves: umap-learn's own default."""
_PAIR_COLUMNS = 5


def plot_violins(path: Path, scores: Mapping[str, NDArray[np.floating]], *, title: str) -> None:
    """Write a PNG of the distributions of `scores`, one violin for each (paper, "Results")."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.violinplot(list(scores.values()), showmedians=True)
    axes.set_xticks(range(1, len(scores) + 1), list(scores))
    axes.set_ylabel("cosine to the nearest image")
    axes.set_title(title, fontsize=8)
    write_figure(path, figure)


def import_umap() -> ModuleType:
    """Import the package umap. Raises InputError if umap-learn is not installed."""
    try:
        import umap
    except ImportError as error:
        raise InputError(
            "the map needs umap-learn; install it with pip install 'laesi_tf[similarity]'"
        ) from error
    return umap


def plot_umap(path: Path, features: Mapping[str, NDArray[np.floating]], *, title: str) -> None:
    """Write a PNG of both sets in the plane that UMAP (McInnes et al., 2018) computes for them together.

    `features` [N, D] are those of the sets "a" and "b". Raises InputError if umap-learn is not installed.
    """
    umap = import_umap()
    together = np.concatenate(list(features.values()))
    neighbours = min(_NEIGHBOURS, len(together) - 1)
    # The spectral initialisation needs more images than dimensions.
    start = "spectral" if len(together) > 2 * _NEIGHBOURS else "random"
    reducer = umap.UMAP(n_neighbors=neighbours, metric="cosine", init=start, random_state=0, n_jobs=1)
    positions = np.split(reducer.fit_transform(together), [len(features["a"])])
    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.subplots()
    for (name, values), points in zip(features.items(), positions, strict=True):
        label = f"{name} ({len(values)})"
        axes.scatter(points[:, 0], points[:, 1], s=8, alpha=0.6, color=_COLOURS[name], label=label)
    axes.legend()
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(title, fontsize=8)
    write_figure(path, figure)


def draw_pairs(
    path: Path,
    images: Mapping[str, NDArray[np.uint8]],
    names: Mapping[str, Sequence[str]],
    pairs: Sequence[tuple[int, int, float]],
) -> None:
    """Write a PNG of `pairs` (row of "a", row of "b", cosine), side by side with their names."""
    tiles = []
    for a, b, cosine in pairs:
        side_by_side = np.concatenate([images["a"][a], images["b"][b]], axis=1)
        tiles.append(add_caption(side_by_side, [f"{cosine:.4f}", f"{names['a'][a]} | {names['b'][b]}"]))
    write_png(path, make_contact_sheet(tiles, columns=_PAIR_COLUMNS))
