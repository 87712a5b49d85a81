"""Charts of the analysis as PNG files."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from laesi_tf.common.atomic_files import write_figure
from sweeps.analysis.effects import Effect
from sweeps.analysis.ranking import RepeatedPoint
from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS

_OPTIMUM_COLOUR = "tab:red"


def plot_main_effects(path: Path, effects: Sequence[Effect]) -> None:
    """The effect of every level with its interval, a panel per factor."""
    factors = list(dict.fromkeys(effect.factor for effect in effects))
    counts = [sum(effect.factor == factor for effect in effects) for factor in factors]
    figure = Figure(figsize=(8, 1.2 + 0.24 * sum(counts)), layout="constrained")
    panels = figure.subplots(len(factors), 1, sharex=True, squeeze=False, height_ratios=counts)[:, 0]
    for axes, factor in zip(panels, factors, strict=True):
        shown = [effect for effect in effects if effect.factor == factor][::-1]
        reach = [[e.change - e.low for e in shown], [e.high - e.change for e in shown]]
        axes.errorbar([e.change for e in shown], range(len(shown)), xerr=reach, fmt="o", markersize=4)
        axes.axvline(0, color="0.6", linewidth=1)
        axes.set_yticks(range(len(shown)), [e.level for e in shown], fontsize=8)
        axes.set_ylim(-0.6, len(shown) - 0.4)
        axes.set_title(factor, fontsize=10, loc="left")
    panels[-1].set_xlabel("MRE against the average of the factor's levels, % (lower is better)")
    write_figure(path, figure)


def plot_interactions(path: Path, pairs: Sequence[Effect], factors: Sequence[str]) -> None:
    """A map of each pair of `factors`, named "one x other": what the pair adds to its two effects."""
    figure = Figure(figsize=(9, 3.2 * len(factors)), layout="constrained")
    panels = figure.subplots(len(factors), 1, squeeze=False)[:, 0]
    for axes, factor in zip(panels, factors, strict=True):
        shown = [effect for effect in pairs if effect.factor == factor]
        rows, columns = (list(dict.fromkeys(e.level.split(" x ")[side] for e in shown)) for side in (0, 1))
        table = np.array([effect.change for effect in shown]).reshape(len(rows), len(columns))
        told = np.array([effect.is_told_apart for effect in shown]).reshape(table.shape)
        bound = max(1.0, float(np.abs(table).max()))
        image = axes.imshow(table, cmap="RdBu_r", vmin=-bound, vmax=bound, aspect="auto")
        for row, column in np.argwhere(told):
            ink = "white" if abs(table[row, column]) > 0.6 * bound else "black"
            written = f"{table[row, column]:+.0f}"
            axes.text(column, row, written, ha="center", va="center", fontsize=7, color=ink)
        axes.set_xticks(range(len(columns)), columns, fontsize=7, rotation=60, ha="right")
        axes.set_yticks(range(len(rows)), rows, fontsize=8)
        axes.set_title(f"{factor}: %, numbers where told apart from 0", fontsize=10, loc="left")
        figure.colorbar(image, ax=axes)
    write_figure(path, figure)


def plot_parallel_coordinates(path: Path, rows: Sequence[TrialRecord]) -> None:
    """Every trial as a line through its levels to its error, the best in colour, the paper's optimum red.

    Errors stand in the order of their ranks: most lie close together and few are many times as large.
    """
    figure = Figure(figsize=(11, 6), layout="constrained")
    axes = figure.subplots()
    errors = np.array([row.mre for row in rows])
    heights = np.argsort(np.argsort(errors, kind="stable")) / max(1, len(rows) - 1)
    random = np.random.default_rng(0)
    best = 0.02
    for place in np.argsort(errors)[::-1]:
        levels = rows[place].point.levels
        at = [FACTORS[name].index(level) / (len(FACTORS[name]) - 1) for name, level in levels.items()]
        # A little apart, so that lines of the same level can be told.
        line = [*(np.array(at) + random.uniform(-0.012, 0.012, len(at))), heights[place]]
        colour = matplotlib.colormaps["viridis"](heights[place])
        if rows[place].point == OPTIMUM:
            axes.plot(line, color=_OPTIMUM_COLOUR, linewidth=2.0, zorder=3)
        elif heights[place] <= best:
            axes.plot(line, color=colour, linewidth=1.2, alpha=0.9)
        else:
            axes.plot(line, color=colour, linewidth=0.6, alpha=0.08)
    for across, names in enumerate(FACTORS.values()):
        for place, name in enumerate(names):
            ground = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.5}
            axes.text(across + 0.02, place / (len(names) - 1), name, fontsize=6, bbox=ground, zorder=4)
    axes.set_xticks(range(len(FACTORS) + 1), [*FACTORS, "MRE, %, by rank"])
    tenths = np.linspace(0, 1, 11)
    axes.yaxis.tick_right()
    axes.set_yticks(tenths, [f"{error:.0f}" for error in np.quantile(errors, tenths)])
    axes.set_xlim(-0.1, len(FACTORS))
    write_figure(path, figure)


def plot_rank_agreement(path: Path, found: Sequence[RepeatedPoint]) -> None:
    """The error at the larger budget against that of the screening."""
    figure = Figure(figsize=(6, 5), layout="constrained")
    axes = figure.subplots()
    optimum = POINTS.index(OPTIMUM)
    for one in found:
        colour = _OPTIMUM_COLOUR if one.number == optimum else "tab:blue"
        axes.loglog(one.screened, one.mre, "o", color=colour)
        axes.annotate(
            str(one.number),
            (one.screened, one.mre),
            fontsize=6,
            xytext=(3, 3),
            textcoords="offset points",
        )
    axes.set(
        xlabel="MRE in the screening, %", ylabel="MRE at the larger budget, geometric mean over seeds, %"
    )
    _use_plain_numbers(axes)
    axes.set_title("red: the paper's optimum", fontsize=9, loc="left")
    write_figure(path, figure)


def plot_search_cost(
    path: Path,
    random: np.ndarray,
    tpe: np.ndarray,
    went: tuple[np.ndarray, np.ndarray] | None,
    *,
    steps: int,
) -> None:
    """The lowest error found against what was spent.

    `random` [3, N] are quantiles of the grid in random order, `tpe` [replays, N] replays, `went` a search as
    it went: steps spent and lowest error after each trial, where a whole trial takes `steps`.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    of_tpe = np.quantile(tpe, [0.1, 0.5, 0.9], axis=0)
    across = np.arange(1, random.shape[1] + 1)
    for label, band, colour in (
        ("grid in random order", random, "0.5"),
        ("TPE, replayed", of_tpe, "tab:blue"),
    ):
        axes.plot(across, band[1], color=colour, label=f"{label}: median, 10 to 90 %")
        axes.fill_between(across, band[0], band[2], color=colour, alpha=0.2)
    if went is not None:
        axes.step(
            went[0] / steps, went[1], where="post", color="tab:orange", label="TPE with pruning, one run"
        )
    axes.set(xscale="log", yscale="log", xlabel="trials; with pruning, steps in units of a trial")
    axes.set_ylabel("lowest MRE, %")
    _use_plain_numbers(axes)
    axes.legend()
    write_figure(path, figure)


def _use_plain_numbers(axes: Axes) -> None:
    """Numbers as 60, not 6 x 10^1, on logarithmic axes; between powers of ten as well where there is room."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(LogFormatter())
        axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.5)))
