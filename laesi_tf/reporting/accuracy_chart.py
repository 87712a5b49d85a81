"""The chart of error against time, and its table."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from laesi_tf.reporting.chart_styles import style_of
from laesi_tf.reporting.markdown import format_table

_HEADER = (
    *("method", "n", "MRE %", "median %", "p90 %", "refused", "> 10 % off", "within 2 sd"),
    *("ms", "first area, s", "peak MB", "models, MB", "training, min"),
)

Row = Mapping[str, Any]
"""One method on one set, as `benchmarks.accuracy` measures it."""


def plot_speed_accuracy(sets: Mapping[str, Sequence[Row]], fronts: Mapping[str, Sequence[Row]]) -> Figure:
    """Plot error against time, a panel for each set, with the front of each as a line.

    Bars are 95 % intervals. A method that refuses more than half of the photos is hollow.
    """
    figure = Figure(figsize=(4.6 * len(sets), 6.6), layout="constrained")
    panels = figure.subplots(1, len(sets), squeeze=False, sharey=True)[0]
    names = list(dict.fromkeys(row["method"] for rows in sets.values() for row in rows))
    for axes, (title, rows) in zip(panels, sets.items(), strict=True):
        front = fronts[title]
        axes.step(
            *([row[key] for row in front] for key in ("ms", "mre_percent")),
            "k-",
            where="post",
            lw=1,
            zorder=1,
        )
        for row in rows:
            if row["mre_percent"] is not None:
                _plot_method(axes, row, names.index(row["method"]))
        for row in front:
            axes.annotate(
                str(names.index(row["method"]) + 1),
                (row["ms"], row["mre_percent"]),
                xytext=(5, 5),
                textcoords="offset points",
                fontsize=9,
                fontweight="bold",
            )
        axes.set(xscale="log", yscale="log", xlabel="ms from a 12-megapixel JPEG to its area", title=title)
        axes.grid(True, which="both", color="0.92", linewidth=0.6)
        axes.set_axisbelow(True)
    panels[0].set_ylabel("mean relative error of the area, %")
    handles, labels = _collect_legend(panels)
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def format_report(setup: str, sets: Mapping[str, Sequence[Row]], fronts: Mapping[str, Sequence[Row]]) -> str:
    """Return a table for each set, and the front of each, as Markdown; `setup` says how it was measured."""
    lines = [setup]
    for name, rows in sets.items():
        best = "; ".join(f"{row['method']} ({row['ms']:.0f} ms)" for row in fronts[name])
        table = format_table(_HEADER, [_make_cells(row) for row in rows], align_right=True)
        lines += ["", f"**{name}**", "", *table, "", f"No method is better in both: {best}."]
    return "\n".join(lines)


def _plot_method(axes: Any, row: Row, number: int) -> None:
    colour, marker = style_of(number)
    below, above = (abs(row["mre_percent"] - row[end]) for end in ("mre_low", "mre_high"))
    is_mostly_refused = row["refused"] > row["n"] / 2
    axes.errorbar(
        row["ms"],
        row["mre_percent"],
        yerr=[[below], [above]],
        color=colour,
        marker=marker,
        markerfacecolor="white" if is_mostly_refused else colour,
        linestyle="none",
        elinewidth=0.8,
        label=f"{number + 1} {row['method']}",
    )


def _collect_legend(panels: Sequence[Any]) -> tuple[list[Any], list[str]]:
    """Return handles and labels by number; a method may be missing from a panel."""
    pairs = [pair for axes in panels for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    known = {label: handle for handle, label in pairs}
    labels = sorted(known, key=lambda label: int(label.split()[0]))
    return [known[label] for label in labels], labels


def _make_cells(row: Row) -> list[str]:
    interval = f" [{_format(row['mre_low'])}, {_format(row['mre_high'])}]"
    return [
        row["method"],
        str(row["n"]),
        _format(row["mre_percent"]) + (interval if row["mre_percent"] is not None else ""),
        *(_format(row[name]) for name in ("median_percent", "p90_percent")),
        *(str(row[name]) for name in ("refused", "silent_errors")),
        "-" if row["within_2_sd"] is None else f"{100 * row['within_2_sd']:.0f} %",
        *(_format(row[name]) for name in ("ms", "first_area_s", "peak_mb", "model_mb", "training_minutes")),
    ]


def _format(value: float | None) -> str:
    """Return three significant digits."""
    if value is None:
        return "-"
    if value == 0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"
