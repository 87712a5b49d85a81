"""Charts of the consistency filter: a histogram of deviations and a sheet of examples."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.geometry import trace_polygons
from laesi_tf.reporting.captions import add_caption, make_contact_sheet
from laesi_tf.reporting.overlay import PREDICTED_COLOUR, TRUE_COLOUR, draw_outlines, resize

_SHOWN_LIMIT = 1.0
"""Deviations above are drawn in the last bar."""
_BINS = 50
_COLUMNS = 6
_TILE_PX = 288


class Example(Protocol):
    """What a tile shows."""

    @property
    def image(self) -> RgbImage:
        """uint8 [H, W, 3]."""
        ...

    @property
    def true(self) -> Mask:
        """The mask that the image was painted for, bool [H, W]."""
        ...

    @property
    def found(self) -> Mask:
        """The mask that the network found, bool [H, W]."""
        ...

    @property
    def deviation(self) -> float:
        """Deviation of the two."""
        ...

    @property
    def is_accepted(self) -> bool:
        """Whether the image is kept."""
        ...


def plot_deviations(deviations: NDArray[np.float64], max_deviation: float) -> Figure:
    """Plot a histogram of `deviations` [N] with the limit; what is above 100 % is in the last bar."""
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    shown = np.minimum(deviations, _SHOWN_LIMIT) * 100
    edges = np.linspace(0, 100 * _SHOWN_LIMIT, _BINS + 1).tolist()
    axes.hist([shown[deviations <= max_deviation], shown[deviations > max_deviation]], edges, stacked=True)
    axes.axvline(100 * max_deviation, color="0.3", linestyle="--")
    rejected = float((deviations > max_deviation).mean())
    axes.set(
        xlabel="deviation of the mask (% of the leaf; the last bar is 98 % and more)",
        ylabel="images",
        title=f"{len(deviations)} images, {rejected:.1%} rejected (more than {max_deviation:.0%})",
    )
    axes.legend(["limit", "accepted", "rejected"])
    return figure


def draw_examples(examples: Sequence[Example]) -> RgbImage:
    """Return a sheet of `examples`: true outline blue, found outline magenta, accepted ones first."""
    tiles = []
    for example in examples:
        scale = _TILE_PX / max(example.image.shape[:2])
        outlines = [
            (ring * scale, colour)
            for mask, colour in ((example.true, TRUE_COLOUR), (example.found, PREDICTED_COLOUR))
            for polygon in trace_polygons(mask)
            for ring in polygon.rings
        ]
        plain = resize(example.image, _TILE_PX)
        drawn = draw_outlines(plain, outlines)
        verdict = "accepted" if example.is_accepted else "rejected"
        both = np.concatenate([plain, drawn])
        tiles.append(add_caption(both, [f"{verdict}, deviation {example.deviation:.1%}"]))
    return make_contact_sheet(tiles, columns=_COLUMNS)
