"""Draw the table as an image, and the error against the number of synthetic images."""

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
"""Those of the last three are the paper's colours."""


def draw_table(
    header: Sequence[str], cells: Sequence[Sequence[str]], heading: Sequence[str], notes: Sequence[str]
) -> Figure:
    """Draw the table with `heading` above and `notes` below it."""
    above, below = _wrap(heading, 150), _wrap(notes, 150)
    heights = [0.36 * (len(cells) + 2) + 0.2 * len(above), 0.2 * (len(below) + 1)]
    figure = Figure(figsize=(13, sum(heights)), layout="constrained")
    top, bottom = figure.subplots(2, 1, height_ratios=heights)
    for axes in (top, bottom):
        axes.axis("off")
    top.set_title("\n".join(above), fontsize=10, loc="left")
    table = top.table([list(row) for row in cells], colLabels=list(header), loc="center", cellLoc="center")
    table.auto_set_font_size(False)
    table.set_fontsize(10)
    table.scale(1, 1.5)
    table.auto_set_column_width(list(range(len(header))))
    for (row, column), cell in table.get_celld().items():
        cell.set_edgecolor("0.85")
        is_paper = row > 0 and header[column] == "paper"
        cell.set_text_props(weight="bold" if row == 0 else "normal", color="0.45" if is_paper else "black")
    bottom.text(0, 1, "\n".join(below), fontsize=9, va="top", color="0.25")
    return figure


def plot_error_by_size(rows: Sequence[TableRow], heading: Sequence[str], scale: float) -> Figure:
    """Plot the validation MRE against the number of synthetic images, a curve for each experiment.

    Our results are filled with the standard deviation over seeds, the paper's are hollow, at the paper's
    numbers of images; the real baseline is a horizontal line. Of shortened experiments (`scale` below 1) the
    axis is logarithmic, as their numbers are far below the paper's.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    names = dict.fromkeys(row.experiment.name for row in rows if row.experiment.name in _COLOURS)
    for name in names:
        _plot_curve(axes, [row for row in rows if row.experiment.name == name], _COLOURS[name], scale)
    if scale != 1.0:
        axes.set_xscale("log")
    axes.set(xlabel="synthetic images in addition to the real ones", ylabel="validation MRE (%)")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    axes.set_title("\n".join(_wrap(heading, 100)), fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _plot_curve(axes: Axes, rows: Sequence[TableRow], colour: str, scale: float) -> None:
    experiment = rows[0].experiment
    metrics = [(shorten(row.count, scale), row.ours["val_mre"]) for row in rows]
    ours = [
        (count, metric.mean, metric.deviation or 0.0) for count, metric in metrics if metric.mean is not None
    ]
    papers = [(row.count, row.paper["val_mre"]) for row in rows if "val_mre" in row.paper]
    title = experiment.title
    if experiment.data_type == "photos":
        for _, mean, _ in ours:
            axes.axhline(mean, color=colour, linestyle="--", label=title)
        for _, value in papers:
            axes.axhline(value, color=colour, linestyle=":", label=f"{title}, paper")
        return
    if ours:
        counts, means, deviations = zip(*ours, strict=True)
        axes.errorbar(counts, means, deviations, color=colour, marker="o", capsize=3, label=title)
    if papers:
        counts, values = zip(*papers, strict=True)
        axes.plot(counts, values, "o", color=colour, fillstyle="none", label=f"{title}, paper")


def _wrap(paragraphs: Sequence[str], width: int) -> list[str]:
    return [line for paragraph in paragraphs for line in textwrap.wrap(paragraph, width)]
