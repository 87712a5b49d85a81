"""Charts of the analysis as PNG files."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatter
from matplotlib.transforms import Bbox

from laesi_tf.common.atomic_files import write_figure
from sweeps.analysis.effects import Effect
from sweeps.analysis.ranking import RepeatedPoint
from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS

_OPTIMUM_COLOUR, _POINT_COLOUR = "tab:red", "tab:blue"
_BEST_SHARE = 0.02
"""Share of the trials that the parallel coordinates emphasise."""


def plot_main_effects(path: Path, effects: Sequence[Effect]) -> None:
    """Plot the effect of every level with its interval, a panel per factor."""
    factors = list(dict.fromkeys(effect.factor for effect in effects))
    counts = [sum(effect.factor == factor for effect in effects) for factor in factors]
    figure = Figure(figsize=(8, 1.2 + 0.24 * sum(counts)), layout="constrained")
    panels = figure.subplots(len(factors), 1, sharex=True, squeeze=False, height_ratios=counts)[:, 0]
    for axes, factor in zip(panels, factors, strict=True):
        levels = [effect for effect in effects if effect.factor == factor][::-1]
        intervals = [[e.change - e.low for e in levels], [e.high - e.change for e in levels]]
        axes.errorbar([e.change for e in levels], range(len(levels)), xerr=intervals, fmt="o", markersize=4)
        axes.axvline(0, color="0.6", linewidth=1)
        axes.set_yticks(range(len(levels)), [e.level for e in levels], fontsize=8)
        axes.set_ylim(-0.6, len(levels) - 0.4)
        axes.set_title(factor, fontsize=10, loc="left")
    panels[-1].set_xlabel("MRE against the average of the factor's levels, % (lower is better)")
    write_figure(path, figure)


def plot_interactions(path: Path, pairs: Sequence[Effect], factors: Sequence[str]) -> None:
    """Plot a map of each pair of `factors`, named "one x other": the interaction of every pair of levels."""
    figure = Figure(figsize=(9, 3.2 * len(factors)), layout="constrained")
    panels = figure.subplots(len(factors), 1, squeeze=False)[:, 0]
    for axes, factor in zip(panels, factors, strict=True):
        effects = [effect for effect in pairs if effect.factor == factor]
        rows, columns = (
            list(dict.fromkeys(effect.level.split(" x ")[side] for effect in effects)) for side in (0, 1)
        )
        changes = np.array([effect.change for effect in effects]).reshape(len(rows), len(columns))
        significant = np.array([effect.is_significant for effect in effects]).reshape(changes.shape)
        bound = max(1.0, float(np.abs(changes).max()))
        image = axes.imshow(changes, cmap="RdBu_r", vmin=-bound, vmax=bound, aspect="auto")
        for row, column in np.argwhere(significant):
            colour = "white" if abs(changes[row, column]) > 0.6 * bound else "black"
            text = f"{changes[row, column]:+.0f}"
            axes.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
        axes.set_xticks(range(len(columns)), columns, fontsize=7, rotation=60, ha="right")
        axes.set_yticks(range(len(rows)), rows, fontsize=8)
        axes.set_title(f"{factor}: %, numbers where significantly different from 0", fontsize=10, loc="left")
        figure.colorbar(image, ax=axes)
    write_figure(path, figure)


def plot_parallel_coordinates(path: Path, records: Sequence[TrialRecord]) -> None:
    """Plot every trial as a line through its levels to the rank of its error.

    Ranks instead of errors: most errors are close together and few are many times as large.
    """
    figure = Figure(figsize=(11, 6), layout="constrained")
    axes = figure.subplots()
    errors = np.array([record.mre for record in records])
    heights = np.argsort(np.argsort(errors, kind="stable")) / max(1, len(records) - 1)
    random = np.random.default_rng(0)
    for index in np.argsort(errors)[::-1]:
        levels = records[index].point.levels
        positions = [FACTORS[name].index(level) / (len(FACTORS[name]) - 1) for name, level in levels.items()]
        # A little apart, so that lines of the same level stay visible.
        line = [*(np.array(positions) + random.uniform(-0.012, 0.012, len(positions))), heights[index]]
        colour = matplotlib.colormaps["viridis"](heights[index])
        if records[index].point == OPTIMUM:
            axes.plot(line, color=_OPTIMUM_COLOUR, linewidth=2.0, zorder=3)
        elif heights[index] <= _BEST_SHARE:
            axes.plot(line, color=colour, linewidth=1.2, alpha=0.9)
        else:
            axes.plot(line, color=colour, linewidth=0.6, alpha=0.08)
    for x, names in enumerate(FACTORS.values()):
        for index, name in enumerate(names):
            box = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.5}
            axes.text(x + 0.02, index / (len(names) - 1), name, fontsize=6, bbox=box, zorder=4)
    axes.set_xticks(range(len(FACTORS) + 1), [*FACTORS, "MRE, %, by rank"])
    tenths = np.linspace(0, 1, 11)
    axes.yaxis.tick_right()
    axes.set_yticks(tenths, [f"{error:.0f}" for error in np.quantile(errors, tenths)])
    axes.set_xlim(-0.1, len(FACTORS))
    figure.legend(handles=_parallel_legend(records), loc="outside lower center", ncols=4, fontsize=8)
    write_figure(path, figure)


def _parallel_legend(records: Sequence[TrialRecord]) -> list[Line2D]:
    lowest, median, highest = (matplotlib.colormaps["viridis"](height) for height in (0.0, 0.5, 1.0))
    handles = [
        Line2D([], [], color=lowest, linewidth=1.2, label=f"best {100 * _BEST_SHARE:.0f} % of the trials"),
        Line2D([], [], color=median, linewidth=0.6, alpha=0.5, label="other trials, median"),
        Line2D([], [], color=highest, linewidth=0.6, alpha=0.5, label="other trials, highest MRE"),
    ]
    if any(record.point == OPTIMUM for record in records):
        handles.append(Line2D([], [], color=_OPTIMUM_COLOUR, linewidth=2.0, label="the paper's optimum"))
    return handles


def plot_rank_agreement(path: Path, points: Sequence[RepeatedPoint]) -> None:
    """Plot the error at the larger budget against that of the screening, each point with its number."""
    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.subplots()
    optimum = POINTS.index(OPTIMUM)
    for label, colour, chosen in (
        ("points, by number", _POINT_COLOUR, [p for p in points if p.number != optimum]),
        ("the paper's optimum", _OPTIMUM_COLOUR, [p for p in points if p.number == optimum]),
    ):
        if chosen:
            axes.loglog([p.screened for p in chosen], [p.mre for p in chosen], "o", color=colour, label=label)
    axes.set_xlabel("MRE in the screening, %")
    axes.set_ylabel("MRE at the larger budget, geometric mean over seeds, %")
    _use_plain_numbers(axes)
    axes.legend(loc="best", fontsize=8)
    # Positions in pixels are final only once the layout is.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    _label_points(axes, [(point.screened, point.mre, str(point.number)) for point in points])
    write_figure(path, figure)


def _label_points(axes: Axes, labels: Sequence[tuple[float, float, str]]) -> None:
    """Write each text (x, y, text) near its point, at the first place that overlaps no text or point."""
    marker, distances = 4.0, (5, 12, 20, 30, 42)
    positions = axes.transData.transform([(x, y) for x, y, _ in labels])
    taken = [Bbox.from_bounds(x - marker, y - marker, 2 * marker, 2 * marker) for x, y in positions]
    for x, y, text in labels:
        for distance, angle in itertools.product(distances, np.linspace(0.25, 2.25, 9)[:-1] * np.pi):
            offset = distance * np.cos(angle), distance * np.sin(angle)
            label = axes.annotate(
                text,
                (x, y),
                fontsize=6,
                xytext=offset,
                textcoords="offset pixels",
                ha="left" if offset[0] > 1 else "right" if offset[0] < -1 else "center",
                va="bottom" if offset[1] > 1 else "top" if offset[1] < -1 else "center",
                arrowprops={"arrowstyle": "-", "color": "0.7", "linewidth": 0.5} if distance > 5 else None,
            )
            box = label.get_window_extent()
            if not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
            label.remove()


def plot_search_cost(
    path: Path,
    random: np.ndarray,
    tpe: np.ndarray,
    pruned: tuple[np.ndarray, np.ndarray] | None,
    *,
    steps: int,
) -> None:
    """Plot the lowest error against the cost of a search.

    `random` [3, N] are quantiles of the grid in random order, `tpe` [replays, N] replays, `pruned` one search
    with pruning: steps spent and lowest error after each trial, where a complete trial takes `steps`.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    trials = np.arange(1, random.shape[1] + 1)
    for label, quantiles, colour in (
        ("grid in random order", random, "0.5"),
        ("TPE, replayed", np.quantile(tpe, [0.1, 0.5, 0.9], axis=0), "tab:blue"),
    ):
        axes.plot(trials, quantiles[1], color=colour, label=f"{label}: median, 10 to 90 %")
        axes.fill_between(trials, quantiles[0], quantiles[2], color=colour, alpha=0.2)
    if pruned is not None:
        spent, lowest = pruned
        axes.step(spent / steps, lowest, where="post", color="tab:orange", label="TPE with pruning, one run")
    axes.set(xscale="log", yscale="log", xlabel="trials; with pruning, steps in units of a trial")
    axes.set_ylabel("lowest MRE, %")
    _use_plain_numbers(axes)
    axes.legend()
    write_figure(path, figure)


def _use_plain_numbers(axes: Axes) -> None:
    """Write 60 instead of 6 x 10^1 on logarithmic axes, and label minor ticks where there is space."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(LogFormatter())
        axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.5)))
