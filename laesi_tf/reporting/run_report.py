"""The report of a run, report.html: one self-contained file that a biologist can read."""

import base64
import dataclasses
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.figure import Figure

from laesi_tf.common.atomic_files import write_text
from laesi_tf.common.run_files import CONFIG_FILE, HISTORY_FILE, REPORT_FILE
from laesi_tf.reporting.run_charts import plot_learning_curves, plot_predicted_against_true
from laesi_tf.training.config import TrainConfig

SYNTHETIC_SCENES = "fresh synthetic pictures"
"""What runs are judged on unless they are given something else."""
_IMAGES_PER_GALLERY = 8
_IMAGE_WIDTH_PX = 192
_BLUE, _MAGENTA = (0, 90, 255), (255, 0, 160)
_METRIC_LABELS = {
    "mre": "mean relative error of the area, MRE (%)",
    "median": "median relative error (%)",
    "p90": "relative error that nine leaves in ten stay below (%)",
    "miou": "mean intersection over union, mIoU",
    "mpe": "mask pixel error, MPE",
    "n": "validation pictures",
    "best_step": "step of the model that was kept",
    "steps": "steps trained",
    "minutes": "minutes",
    "images_per_s": "pictures trained on per second",
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
    """A validation picture: uint8 [H, W, 3], its figures by name, predicted and true mask bool [H, W]."""

    image: np.ndarray
    figures: Mapping[str, float]
    masks: tuple[np.ndarray, np.ndarray] | None


def select_best_and_worst(errors: np.ndarray) -> list[int]:
    """Indices of the pictures to show, best first: those of the lowest errors [N], then of the highest."""
    order = np.argsort(errors, kind="stable").tolist()
    half = min(_IMAGES_PER_GALLERY, len(order) // 2)
    return order[:half] + order[len(order) - half :]


def write_report(
    out: Path,
    config: TrainConfig,
    figures: Mapping[str, Any],
    history: Sequence[Mapping[str, float]],
    found: Mapping[str, np.ndarray],
    pictures: Sequence[ValidationImage],
    *,
    validated_on: str = SYNTHETIC_SCENES,
) -> None:
    """Write report.html into the run's folder `out`; `validated_on` says what its figures were found on.

    `figures` are those of metrics.json, `history` the rows of history.csv, `found` arrays [N] over the
    validation set ("predicted" and "true" for areas), `pictures` those of `chosen` in its order.
    """
    half = len(pictures) // 2
    parts = [
        f"<h1>{'Leaf area' if config.task == 'area' else 'Leaf mask'}, run {html.escape(out.name)}</h1>",
        _make_headline(config, figures, validated_on),
        f"<h2>Figures</h2>{_table_to_html({_METRIC_LABELS[key]: value for key, value in figures.items() if key in _METRIC_LABELS})}",
        f"<h2>Learning</h2>{_figure_to_html(plot_learning_curves(history))}<p class=note>The same numbers are in {HISTORY_FILE}.</p>",
        f"<h2>Predicted against true</h2>{_figure_to_html(plot_predicted_against_true(found))}"
        if config.task == "area"
        else "",
        f"<h2>Best pictures</h2>{_gallery_to_html(pictures[:half])}",
        f"<h2>Worst pictures</h2>{_gallery_to_html(pictures[half:][::-1])}",
        f"<h2>Configuration</h2>{_table_to_html(dataclasses.asdict(config))}",
        f"<p class=note>{CONFIG_FILE} repeats this run: pass it to --config.</p>",
    ]
    title = f"<title>{html.escape(out.name)}</title>"
    head = f"<!doctype html><html lang=en><meta charset=utf-8>{title}<style>{_STYLE}</style>"
    write_text(out / REPORT_FILE, "\n".join([head, *filter(None, parts), "</html>\n"]))


def _make_headline(config: TrainConfig, figures: Mapping[str, Any], validated_on: str) -> str:
    if config.task == "area":
        told = (
            f"On {validated_on} the area is off by {figures['mre']:.1f} % on average; "
            f"half are within {figures['median']:.1f} %, nine in ten within {figures['p90']:.1f} %."
        )
    else:
        told = (
            f"On {validated_on} true and predicted leaf overlap by {figures['miou']:.3f} "
            f"(1 is perfect), and the leaf's pixel count is off by {100 * figures['mpe']:.1f} %."
        )
    told += " Real photos differ: score those with evaluate." if validated_on == SYNTHETIC_SCENES else ""
    return f"<p>{told}</p>"


def _gallery_to_html(pictures: Sequence[ValidationImage]) -> str:
    shown = (
        f"<figure>{_image_to_html(picture)}<figcaption>{_make_caption(picture)}</figcaption></figure>"
        for picture in pictures
    )
    return f"<div class=pictures>{''.join(shown)}</div>"


def _make_caption(picture: ValidationImage) -> str:
    if picture.masks:
        return f"overlap (IoU) {picture.figures['iou']:.3f}; predicted magenta, true blue"
    predicted, true = picture.figures["predicted"], picture.figures["true"]
    return f"{predicted:.1f} cm² for {true:.1f} cm²: {100 * (predicted / true - 1):+.1f} %"


def _image_to_html(picture: ValidationImage) -> str:
    scale = _IMAGE_WIDTH_PX / picture.image.shape[1]
    drawn = cv2.resize(picture.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # The true outline goes first, so that the predicted one covers it where they agree.
    for mask, colour in zip((picture.masks or ())[::-1], (_BLUE, _MAGENTA), strict=False):
        large = cv2.resize(mask.astype(np.uint8), drawn.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        contours, _ = cv2.findContours(large, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, contours, -1, colour, 1)
    encoded = cv2.imencode(".jpg", drawn[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()
    return f"<img alt='' src='data:image/jpeg;base64,{base64.b64encode(encoded).decode()}'>"


def _figure_to_html(figure: Figure) -> str:
    data = io.BytesIO()
    with matplotlib.rc_context({"axes.spines.top": False, "axes.spines.right": False}):
        figure.savefig(data, format="png", dpi=110)
    return f"<img alt='' src='data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}'>"


def _table_to_html(rows: Mapping[str, Any]) -> str:
    cells = (
        f"<tr><td>{html.escape(key)}<td>{html.escape(_format_value(value))}" for key, value in rows.items()
    )
    return f"<table>{''.join(cells)}</table>"


def _format_value(value: Any) -> str:
    if isinstance(value, tuple):
        return " × ".join(map(str, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
