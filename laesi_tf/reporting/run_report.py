"""The report of a run, report.html: one self-contained file that a biologist can read."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.atomic_files import write_text
from laesi_tf.common.geometry import trace_polygons
from laesi_tf.common.run_files import CONFIG_FILE, HISTORY_FILE, REPORT_FILE
from laesi_tf.reporting.html_page import encode_figure, encode_jpeg, show_jpeg, show_png
from laesi_tf.reporting.overlay import PREDICTED_COLOUR, TRUE_COLOUR, draw_outlines
from laesi_tf.reporting.run_charts import plot_learning_curves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SYNTHETIC_SCENES = "fresh synthetic images"
"""What runs are validated on unless they are given something else."""
_IMAGE_WIDTH_PX = 192
_RUN_LABELS = {
    "n": "validation images",
    "best_step": "step of the network that was kept",
    "steps": "steps trained",
    "minutes": "minutes",
    "images_per_s": "images trained on per second",
    "parameters": "parameters",
    "weights_origin": "weights it started from",
}
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #223; max-width: 62rem; margin: 2rem auto; padding: 1rem }
h1 { font-weight: 600 } h2 { margin-top: 2.5rem; font-weight: 600 }
table { border-collapse: collapse } td { padding: .15rem 1.5rem .15rem 0; vertical-align: top }
td:last-child { font-variant-numeric: tabular-nums } img { max-width: 100% }
.pictures { display: flex; flex-wrap: wrap; gap: .75rem } figure { margin: 0; width: 12rem }
figcaption { font-size: .85rem; color: #556 } p.note { color: #556 }
"""


@dataclass(frozen=True)
class ValidationImage:
    """A validation image, uint8 [H, W, 3], its caption, and the predicted and the true mask, bool [H, W]."""

    image: NDArray[np.uint8]
    caption: str
    masks: tuple[NDArray[Any], NDArray[Any]] | None = None


@dataclass(frozen=True, kw_only=True)
class RunReport:
    """What the report of a run shows."""

    title: str
    headline: str
    metrics: Mapping[str, Any]
    """The content of metrics.json."""
    metric_labels: Mapping[str, str]
    """Names and units of the task's metrics."""
    history: Sequence[Mapping[str, float]]
    """The rows of history.csv."""
    main_metric: str
    charts: "Sequence[tuple[str, Figure]]"
    """Further charts, each with its heading."""
    best: Sequence[ValidationImage]
    worst: Sequence[ValidationImage]
    config: Mapping[str, Any]


def write_report(out: Path, report: RunReport) -> None:
    """Write report.html into the run directory `out`."""
    labels = {**report.metric_labels, **_RUN_LABELS}
    shown = {labels[name]: value for name, value in report.metrics.items() if name in labels}
    label = report.metric_labels[report.main_metric]
    curves = plot_learning_curves(report.history, f"val_{report.main_metric}", label)
    sections = [
        f"<h1>{html.escape(report.title)}</h1>",
        f"<p>{html.escape(report.headline)}</p>",
        f"<h2>Figures</h2>{_table_to_html(shown)}",
        f"<h2>Learning</h2>{_figure_to_html(curves)}",
        f"<p class=note>The same numbers are in {HISTORY_FILE}.</p>",
        *(f"<h2>{html.escape(heading)}</h2>{_figure_to_html(figure)}" for heading, figure in report.charts),
        f"<h2>Best images</h2>{_gallery_to_html(report.best)}",
        f"<h2>Worst images</h2>{_gallery_to_html(report.worst)}",
        f"<h2>Configuration</h2>{_table_to_html(report.config)}",
        f"<p class=note>{CONFIG_FILE} repeats this run: pass it to --config.</p>",
    ]
    title = f"<title>{html.escape(report.title)}</title>"
    head = f"<!doctype html><html lang=en><meta charset=utf-8>{title}<style>{_STYLE}</style>"
    write_text(out / REPORT_FILE, "\n".join([head, *sections, "</html>\n"]))


def _gallery_to_html(images: Sequence[ValidationImage]) -> str:
    figures = (
        f"<figure>{_image_to_html(shown)}<figcaption>{html.escape(shown.caption)}</figcaption></figure>"
        for shown in images
    )
    return f"<div class=pictures>{''.join(figures)}</div>"


def _image_to_html(shown: ValidationImage) -> str:
    scale = _IMAGE_WIDTH_PX / shown.image.shape[1]
    canvas = cv2.resize(shown.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # The true outline is drawn first, so that the predicted one covers it where they agree.
    for mask, colour in zip((shown.masks or ())[::-1], (TRUE_COLOUR, PREDICTED_COLOUR), strict=False):
        rings = [ring * scale for polygon in trace_polygons(mask) for ring in polygon.rings]
        canvas = draw_outlines(canvas, [(ring, colour) for ring in rings])
    return show_jpeg(encode_jpeg(canvas, 88))


def _figure_to_html(figure: "Figure") -> str:
    with matplotlib.rc_context({"axes.spines.top": False, "axes.spines.right": False}):
        return show_png(encode_figure(figure, dpi=110))


def _table_to_html(rows: Mapping[str, Any]) -> str:
    cells = (
        f"<tr><td>{html.escape(key)}<td>{html.escape(_format_value(value))}" for key, value in rows.items()
    )
    return f"<table>{''.join(cells)}</table>"


def _format_value(value: Any) -> str:
    if isinstance(value, tuple):
        return " × ".join(map(str, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
