"""Millimetre paper to print: a vector PDF with a bar that shows whether the printer scales."""

import io
from typing import Any, NamedTuple

from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from laesi_tf.common.units import MM_PER_INCH


class Paper(NamedTuple):
    """A size of paper and the whole centimetres of ruling that fit on what every printer can print."""

    width_mm: float
    height_mm: float
    ruled_width_mm: int
    ruled_height_mm: int


PAPERS = {"a4": Paper(210.0, 297.0, 190, 250), "letter": Paper(215.9, 279.4, 190, 230)}
_BOTTOM_MM = 10.0
_COLOUR = (0.0, 0.62, 0.88)
"""Close to the cyan of printers, which they need not mix from dots; no leaf has it."""
_LEVELS = ((1, 0.09), (5, 0.18), (10, 0.32))
"""Distance and width of the lines, mm: each level is drawn over the finer ones."""
_POINTS_PER_MM = 72 / MM_PER_INCH
_BAR_MM = 100
_TEXT = (
    "1.  Lay the leaf flat on the grid, with two centimetres of bare grid around it.",
    "2.  Hold the phone parallel to the sheet, so that the leaf fills a third to two thirds of the picture.",
    "3.  Take the photo in even light: no shadow of yours, no flash, no zoom, and the thin lines sharp.",
)
_SCALING = (
    "Print at 100 % (“actual size”). This bar must be 100 mm long: check it with a ruler. If it has 97 mm,",
    "name the line distance 0.97: in the settings of the page, or with laesi predict --grid-mm 0.97.",
)


def make_figure(paper: Paper) -> Figure:
    """Return the sheet as a figure of the paper's size with axes in mm from the lower left corner."""
    figure = Figure((paper.width_mm / MM_PER_INCH, paper.height_mm / MM_PER_INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, paper.width_mm), ylim=(0, paper.height_mm))
    axes.set_axis_off()
    left = (paper.width_mm - paper.ruled_width_mm) / 2
    right, top = left + paper.ruled_width_mm, _BOTTOM_MM + paper.ruled_height_mm
    for distance, width in _LEVELS:
        across = [
            [(left + x, _BOTTOM_MM), (left + x, top)] for x in range(0, paper.ruled_width_mm + 1, distance)
        ]
        down = [
            [(left, _BOTTOM_MM + y), (right, _BOTTOM_MM + y)]
            for y in range(0, paper.ruled_height_mm + 1, distance)
        ]
        lines = LineCollection(
            across + down, colors=[_COLOUR], linewidths=width * _POINTS_PER_MM, capstyle="projecting"
        )
        # Where they are, not where pixels are, when the figure is drawn as an image.
        lines.set_snap(False)
        axes.add_collection(lines)
    text: dict[str, Any] = {"fontsize": 8.2, "color": "0.15", "va": "baseline"}
    for number, line in enumerate(_TEXT):
        axes.text(left, top + 27.0 - 4.2 * number, line, **text)
    height = top + 11.5
    bar = [
        [(left, height), (left + _BAR_MM, height)],
        *([(left + x, height - 1.5), (left + x, height + 1.5)] for x in (0, _BAR_MM)),
    ]
    axes.add_collection(LineCollection(bar, colors="0.15", linewidths=0.25 * _POINTS_PER_MM, capstyle="butt"))
    axes.text(left + _BAR_MM + 2, height, "100 mm", **(text | {"va": "center"}))
    for number, line in enumerate(_SCALING):
        axes.text(left, top + 6.4 - 3.4 * number, line, **(text | {"fontsize": 7.2}))
    return figure


def draw_sheet(paper: Paper) -> bytes:
    """Return the sheet as a PDF, the same bytes each time."""
    content = io.BytesIO()
    details = {"Title": "Millimetre paper for leaf areas", "Creator": "laesi_tf", "CreationDate": None}
    make_figure(paper).savefig(content, format="pdf", metadata=details)
    return content.getvalue()
