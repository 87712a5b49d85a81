"""The page of a stress run: one self-contained HTML file that says when to trust which method."""

import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.atomic_files import write_text
from laesi_tf.reporting.chart_styles import style_of
from laesi_tf.reporting.html_page import begin_page, encode_figure, encode_jpeg, show_jpeg, show_png

_JPEG_QUALITY = 95
_CHART_COLOURS = 160
"""Lines on white need few: two dozen charts would fill megabytes."""
_LEAST_PERCENT = 0.1
"""Errors below this are drawn at this."""
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #223; background: #fff; max-width: 76rem;
  margin: 2rem auto; padding: 0 1rem }
h1, h2 { font-weight: 600 } h2 { margin-top: 2.5rem }
table { border-collapse: collapse; font-size: .9rem } .wide { overflow-x: auto }
td, th { padding: .15rem 1rem .15rem 0; text-align: left; font-variant-numeric: tabular-nums }
tr + tr { border-top: 1px solid #e4e6ea } .dim { color: #566 }
img { max-width: 100%; height: auto }
.photos { display: grid; grid-template-columns: repeat(auto-fill, minmax(14rem, 1fr)); gap: 1rem }
figure { margin: 0 } figcaption { font-size: .85rem }
"""

Row = Mapping[str, Any]
"""One severity, method and set, as `benchmarks.stress.summary` makes it."""


@dataclass(frozen=True)
class Failure:
    """A picture that a method got wrong without a word."""

    image: RgbImage
    """With the true and the measured outline."""
    caption: str


@dataclass(frozen=True, kw_only=True)
class StressReport:
    """What the page shows."""

    facts: Sequence[str]
    rows: Mapping[tuple[str, str], Mapping[str, Sequence[Row]]]
    """By (nuisance, set), then by method, in order of severity."""
    breakdowns: Sequence[Row]
    risk: Mapping[str, Sequence[float | None]]
    set_aside: Sequence[float]
    failures: Sequence[Failure]


def write_stress_page(path: Path, report: StressReport) -> None:
    """Write the page. Raises InputError where it cannot be written."""
    write_text(path, "".join(_format_page(report)))


def list_breakdowns(breakdowns: Sequence[Row], method: str) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the table of where a method breaks, sets side by side."""
    sets = list(dict.fromkeys(row["set"] for row in breakdowns))
    header = ["nuisance", *(f"{name}: {what}" for name in sets for what in ("> 5 %, > 25 %", "half refused"))]
    table = []
    for nuisance in dict.fromkeys(row["nuisance"] for row in breakdowns):
        found = {
            row["set"]: row for row in breakdowns if row["nuisance"] == nuisance and row["method"] == method
        }
        unit = next((row["unit"] for row in found.values()), "")
        cells = [f"{nuisance} ({unit})" if unit else nuisance]
        for name in sets:
            row = found.get(name)
            if row is None:
                cells += ["", ""]
            else:
                over = [row["over_5_percent"] or "-", row["over_25_percent"] or "-"]
                cells += [", ".join(over), row["half_refused"] or "-"]
        table.append(cells)
    return header, table


def _format_page(report: StressReport) -> Iterator[str]:
    yield begin_page("When to trust which method", _STYLE)
    yield (
        "<p>One nuisance at a time, from none to absurd, everything "
        f"else fixed. {html.escape('; '.join(report.facts))}.</p>\n"
    )
    methods = list(dict.fromkeys(method for by_method in report.rows.values() for method in by_method))
    for method in methods:
        header, table = list_breakdowns(report.breakdowns, method)
        yield (
            f"<h2>{html.escape(method)}: breaks at</h2>\n"
            if method == methods[0]
            else (f"<details><summary>{html.escape(method)}: breaks at</summary>\n")
        )
        yield from _format_table(header, table)
        yield "" if method == methods[0] else "</details>\n"
    yield (
        '<p class="dim">The first severity at which the mean relative error of what was measured passes '
        "5 % and 25 %, and at which half of the pictures are refused; - where none does.</p>\n"
    )
    yield from _format_risk(report)
    if report.failures:
        yield (
            f"<h2>First failures of {html.escape(methods[0])}</h2>\n<p>More than 10 % off and not refused. "
            'Outlines: true blue, measured magenta.</p>\n<div class="photos">\n'
        )
        yield from (_format_failure(failure) for failure in report.failures)
        yield "</div>\n"
    for nuisance in dict.fromkeys(name for name, _ in report.rows):
        sets = {name: rows for (of, name), rows in report.rows.items() if of == nuisance}
        chart = encode_figure(plot_nuisance(sets, methods), dpi=80, colours=_CHART_COLOURS)
        shown = f"Error, bias, refusals and coverage by severity of {nuisance}"
        yield f"<h2>{html.escape(nuisance)}</h2>\n{show_png(chart, shown)}\n"
    yield "</body></html>\n"


def plot_nuisance(sets: Mapping[str, Mapping[str, Sequence[Row]]], methods: Sequence[str]) -> Figure:
    """Plot one nuisance: a row of panels for each set, a line for each method.

    Bands are 95 % intervals over the pictures. Hollow markers: some areas are more than 10 % off unsaid.
    """
    figure = Figure(figsize=(12, 2.9 * len(sets) + 0.5), layout="constrained")
    grid = figure.subplots(len(sets), 4, squeeze=False)
    for panels, (name, by_method) in zip(grid, sets.items(), strict=True):
        first = next(iter(by_method.values()))
        for method, rows in by_method.items():
            _plot_method(panels, rows, *style_of(methods.index(method)))
        panels[0].set(yscale="log", ylabel=f"{name}\nMRE, %", ylim=(_LEAST_PERCENT, None))
        panels[1].set(ylabel="bias, %")
        panels[1].set_yscale("symlog", linthresh=1)
        panels[2].set(ylabel="refused, %", ylim=(-4, 104))
        panels[3].set(ylabel="within 2 sd, %", ylim=(-4, 104))
        panels[3].axhline(95, color="0.7", linewidth=0.8)
        for axes in panels:
            labels = [row["severity"] for row in first]
            axes.set_xticks(range(len(labels)), labels, fontsize=8)
            if max(map(len, labels)) > 5:
                axes.tick_params(axis="x", rotation=60)
            axes.set_xlabel(first[0]["unit"], fontsize=9)
            axes.grid(True, color="0.92", linewidth=0.6)
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8, frameon=False)
    return figure


def _plot_method(panels: Sequence[Any], rows: Sequence[Row], colour: str, marker: str) -> None:
    def values(key: str, factor: float = 1.0) -> np.ndarray:
        return np.array([np.nan if row[key] is None else factor * row[key] for row in rows], float)

    steps = np.arange(len(rows))
    refused = 100 * values("refused") / values("n")
    lines = (
        np.maximum(values("mre_percent"), _LEAST_PERCENT),
        values("bias_percent"),
        refused,
        values("within_2_sd", 100),
    )
    for axes, line in zip(panels, lines, strict=True):
        axes.plot(steps, line, color=colour, linewidth=1.2, label=rows[0]["method"])
    low, high = (np.maximum(values(name), _LEAST_PERCENT) for name in ("mre_low", "mre_high"))
    panels[0].fill_between(steps, low, high, color=colour, alpha=0.12, linewidth=0)
    is_silent = values("silent_errors") > 0
    for chosen, face in ((is_silent, "white"), (~is_silent, colour)):
        panels[0].plot(
            steps[chosen], lines[0][chosen], marker, color=colour, markerfacecolor=face, markersize=5
        )


def _format_risk(report: StressReport) -> Iterator[str]:
    if not report.risk:
        return
    yield "<h2>What is left when the least certain areas are set aside</h2>\n"
    header = ["method", *(f"{100 * share:.0f} % set aside" for share in report.set_aside)]
    table = [
        [method, *("-" if value is None else f"{value:.2f} %" for value in values)]
        for method, values in report.risk.items()
    ]
    yield from _format_table(header, table)
    yield '<p class="dim">Mean relative error over all severities and sets.</p>\n'


def _format_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield '<div class="wide"><table>\n'
    for tag, cells in (("th", header), *(("td", row) for row in rows)):
        yield "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>\n"
    yield "</table></div>\n"


def _format_failure(failure: Failure) -> str:
    picture = show_jpeg(encode_jpeg(failure.image, _JPEG_QUALITY))
    return f"<figure>{picture}<figcaption>{html.escape(failure.caption)}</figcaption></figure>\n"
