"""Draw the table as an image, and the error against the number of synthetic pictures."""

import textwrap
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.experiment_specs import shorten
from experiments.results import TableRow

_COLOURS = {
    "real_baseline": "0.4",
    "rendering_1": "tab:green",
    "rendering_2": "tab:orange",
    "controlnet": "tab:red",
    "controlnet_filtering": "tab:blue",
}
"""Of the last three, the paper's colours."""


def draw_table(
    header: Sequence[str], cells: Sequence[Sequence[str]], heading: Sequence[str], notes: Sequence[str]
) -> Figure:
    """The table with `heading` above and `notes` below it."""
    above, below = _wrap(heading, 150), _wrap(notes, 150)
    heights = [0.36 * (len(cells) + 2) + 0.2 * len(above), 0.2 * (len(below) + 1)]
    figure = Figure(figsize=(13, sum(heights)), layout="constrained")
    top, bottom = figure.subplots(2, 1, height_ratios=heights)
    for axes in (top, bottom):
        axes.axis("off")
    top.set_title("\n".join(above), fontsize=10, loc="left")
    drawn = top.table([list(row) for row in cells], colLabels=list(header), loc="center", cellLoc="center")
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(10)
    drawn.scale(1, 1.5)
    drawn.auto_set_column_width(list(range(len(header))))
    for (row, column), cell in drawn.get_celld().items():
        cell.set_edgecolor("0.85")
        grey = row > 0 and header[column] == "paper"
        cell.set_text_props(weight="bold" if row == 0 else "normal", color="0.45" if grey else "black")
    bottom.text(0, 1, "\n".join(below), fontsize=9, va="top", color="0.25")
    return figure


def _wrap(paragraphs: Sequence[str], width: int) -> list[str]:
    return [line for paragraph in paragraphs for line in textwrap.wrap(paragraph, width)]


def plot_error_by_size(lines: Sequence[TableRow], heading: Sequence[str], scale: float) -> Figure:
    """Validation MRE against synthetic pictures, a curve for each row (the paper's figure of losses).

    Ours filled with the deviation over seeds, the paper's hollow; the real baseline as a horizontal line.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    names = dict.fromkeys(line.row.name for line in lines if line.row.name in _COLOURS)
    for name in names:
        _plot_curve(axes, [line for line in lines if line.row.name == name], _COLOURS[name], scale)
    axes.set(xlabel="synthetic pictures beside the real ones", ylabel="validation MRE (%)")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    axes.set_title("\n".join(_wrap(heading, 100)), fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _plot_curve(axes: Axes, lines: Sequence[TableRow], colour: str, scale: float) -> None:
    title = lines[0].row.title
    cells = [(shorten(line.count, scale), line.ours["val_mre"]) for line in lines]
    ours = [(count, cell.mean, cell.deviation or 0.0) for count, cell in cells if cell.mean is not None]
    papers = [
        (shorten(line.count, scale), line.paper["val_mre"]) for line in lines if "val_mre" in line.paper
    ]
    if lines[0].row.kind == "photos":
        for _, mean, _ in ours:
            axes.axhline(mean, color=colour, linestyle="--", label=title)
        for _, value in papers:
            axes.axhline(value, color=colour, linestyle=":", label=f"{title}, paper")
        return
    if ours:
        counts, means, deviations = zip(*ours, strict=True)
        axes.errorbar(counts, means, deviations, color=colour, marker="o", capsize=3, label=title)
    if papers:
        axes.plot(*zip(*papers, strict=True), "o", color=colour, fillstyle="none", label=f"{title}, paper")
