"""The chart of an ablation: what each component of a scene is worth against what it costs."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

_LABELS = {
    "mre": "MRE, points",
    "mpe": "MPE",
    "miou": "mIoU",
    "scale_median": "median error of the scale, points",
    "refused_share": "share refused",
}
_COLOURS = {"without": "#D55E00", "only": "#0072B2"}
_NAMES = {"without": "removed from all", "only": "alone on the barest scene"}
_LEAST_US = 1.0

Row = Mapping[str, Any]
"""One component, changed one way, as `benchmarks.ablation` makes it."""


def plot_ablation(rows: Sequence[Row]) -> Figure:
    """Plot the change of each metric against microseconds a picture: panels for each task, metric and set.

    Components removed from all stand on the left, alone on the barest scene on the right, since the latter
    change far more. Bars are 95 % intervals over seeds. Components whose interval holds zero are faint.
    """
    changed = [row for row in rows if row["change"]]
    keys = list(dict.fromkeys((row["task"], row["metric"], row["set"]) for row in changed))
    figure = Figure(figsize=(13, 3.8 * len(keys)), layout="constrained")
    panels = figure.subplots(len(keys), len(_NAMES), squeeze=False)
    for line, key in zip(panels, keys, strict=True):
        for axes, change in zip(line, _NAMES, strict=True):
            for row in changed:
                if (row["task"], row["metric"], row["set"]) == key and row["change"] == change:
                    _plot_component(axes, row)
            axes.axhline(0, color="0.4", linewidth=0.8)
            task, metric, name = key
            axes.set(
                xscale="log",
                xlabel="µs of CPU a picture",
                ylabel=f"change of {_LABELS[metric]}",
                title=f"{task}, {name}: {_NAMES[change]}",
            )
            axes.margins(x=0.15)  # room for the last names
            axes.grid(True, color="0.93", linewidth=0.6)
    return figure


def _plot_component(axes: Any, row: Row) -> None:
    cost = max(row["us"] or _LEAST_US, _LEAST_US)
    is_sure = row["low"] is not None and (row["low"] > 0 or row["high"] < 0)
    error = None
    if row["low"] is not None:
        error = [[row["difference"] - row["low"]], [row["high"] - row["difference"]]]
    axes.errorbar(
        cost,
        row["difference"],
        yerr=error,
        marker="o" if row["change"] == "without" else "s",
        linestyle="none",
        color=_COLOURS[row["change"]],
        alpha=1.0 if is_sure else 0.35,
        elinewidth=0.8,
    )
    axes.annotate(
        row["component"], (cost, row["difference"]), xytext=(4, 2), textcoords="offset points", fontsize=7
    )
