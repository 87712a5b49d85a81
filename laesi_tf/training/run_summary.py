"""Metrics and report of a run's best network."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.common.run_files import METRICS_FILE
from laesi_tf.models.saved_model import load_run
from laesi_tf.reporting.run_report import SYNTHETIC_SCENES, RunReport, ValidationImage, write_report
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.run_directory import TrainingProgress
from laesi_tf.training.tasks import make_task
from laesi_tf.training.tasks.base import Array
from laesi_tf.training.trainer import evaluate_network

_IMAGES_PER_GALLERY = 8


@dataclass(frozen=True)
class TrainingResult:
    """A finished run and the content of its metrics.json."""

    path: Path
    config: TrainConfig
    metrics: dict[str, Any]


def load_result(path: Path, config: TrainConfig) -> TrainingResult:
    """Return the result of the finished run in `path`."""
    return TrainingResult(path, config, json.loads((path / METRICS_FILE).read_text(encoding="utf-8")))


def summarise_best_network(
    path: Path,
    config: TrainConfig,
    progress: TrainingProgress,
    validation: Sequence[tuple[tf.Tensor, tf.Tensor]],
    *,
    weights_origin: str,
    validation_name: str,
) -> dict[str, Any]:
    """Evaluate the best network so far, write the run's report, and return the metrics that it shows."""
    task, model = make_task(config), load_run(path).model
    arrays = evaluate_network(model, task, validation)
    rates = [row["images_per_s"] for row in progress.history if math.isfinite(row["images_per_s"])]
    metrics = {
        "task": config.task,
        **task.aggregate(arrays),
        "n": len(arrays["error"]),
        "best_step": progress.best_step,
        "steps": progress.step,
        "minutes": progress.seconds / 60.0,
        "images_per_s": float(np.median(rates)) if rates else math.nan,
        "parameters": model.count_params(),
        "weights_origin": weights_origin,
    }
    shown = select_best_and_worst(arrays["error"])
    images = [_show_validation_image(config, model, validation, arrays, index) for index in shown]
    headline = task.headline(metrics, validation_name)
    if validation_name == SYNTHETIC_SCENES:
        headline += " Real photos differ: score those with evaluate."
    report = RunReport(
        title=f"{task.title}, run {path.absolute().name}",
        headline=headline,
        metrics=metrics,
        metric_labels=task.metric_labels,
        history=progress.history,
        main_metric=task.main_metric,
        charts=task.charts(arrays),
        best=images[: len(images) // 2],
        worst=images[len(images) // 2 :][::-1],
        config=asdict(config),
    )
    write_report(path, report)
    return metrics


def select_best_and_worst(errors: Array) -> list[int]:
    """Return indices of the images to show: the lowest errors [N], rising, then the highest."""
    order: list[int] = np.argsort(errors, kind="stable").tolist()
    half = min(_IMAGES_PER_GALLERY, len(order) // 2)
    return order[:half] + order[len(order) - half :]


def _show_validation_image(
    config: TrainConfig,
    model: Any,
    validation: Sequence[tuple[tf.Tensor, tf.Tensor]],
    arrays: dict[str, Array],
    index: int,
) -> ValidationImage:
    """Return image `index` of the validation set with its caption and, for masks, the two masks."""
    task = make_task(config)
    batch, position = divmod(index, len(validation[0][0]))
    images, targets = validation[batch]
    output = model(images[position : position + 1], training=False).numpy()[0]
    values = {
        name: float(array[index]) for name, array in arrays.items() if len(array) == len(arrays["error"])
    }
    return ValidationImage(
        images[position].numpy(), task.caption(values), task.masks(output, targets[position].numpy())
    )
