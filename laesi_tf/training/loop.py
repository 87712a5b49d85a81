"""The training loop with validation, checkpoints and continuation."""

import itertools
import json
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.common import run_files
from laesi_tf.common.atomic_files import atomic_write, write_json
from laesi_tf.common.progress import progress_bar
from laesi_tf.models import batch_norm
from laesi_tf.models.saved_model import load_run
from laesi_tf.reporting import run_report
from laesi_tf.training import run_directory
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.input_pipeline import BatchStream, make_training_stream, make_validation_batches
from laesi_tf.training.optimizers import make_optimizer
from laesi_tf.training.run_directory import TrainingProgress
from laesi_tf.training.schedules import SCHEDULES
from laesi_tf.training.tasks import make_task
from laesi_tf.training.trainer import (
    Batches,
    Trainer,
    TrainingDiverged,
    evaluate_network,
    initialise_network,
)

_CALIBRATION_PICTURES = 512
"""Batch normalisation is recalibrated on this many pictures."""


@dataclass(frozen=True)
class TrainingResult:
    """A finished run and the figures in its metrics.json."""

    path: Path
    config: TrainConfig
    metrics: dict[str, Any]


def fit(
    config: TrainConfig,
    out: Path | str,
    *,
    train: BatchStream | None = None,
    validation: Batches | None = None,
    data_service: str = "",
    validated_on: str = run_report.SYNTHETIC_SCENES,
    show: bool = True,
) -> TrainingResult:
    """Train what `config` says into the folder `out`, or continue the run that is there.

    `train` and `validation` replace the live synthetic scenes; `validation` is held in memory, and the report
    calls it `validated_on`. `data_service` HOST:PORT has the scenes made elsewhere, with the same result.
    `show` draws a progress bar. Raises InputError for a folder that holds something else and Diverged when
    the loss is NaN.
    """
    out = Path(out)
    origin = run_directory.check_run_directory(out, config)
    started = origin if (out / run_files.STATE_FILE).is_file() else None
    model, origin = initialise_network(config, origin=started)
    follower = make_optimizer(
        config.optimizer,
        schedule=config.schedule,
        peak=config.learning_rate,
        final=config.final_learning_rate,
        steps=config.steps,
    )
    learner = Trainer(model, make_task(config), follower)
    progress = run_directory.restore_state(out, learner.variables)
    fitting = TrainingLoop(
        config, out, learner, progress, train or make_training_stream(config, data_service)
    )
    fitting.validation = list(make_validation_batches(config) if validation is None else validation)
    fitting.validated_on = validated_on
    if started is None:
        run_directory.create_run_directory(out, config, origin)
    try:
        fitting.run(show=show)
    except KeyboardInterrupt:
        if progress.history:
            summarise_best_model(fitting, origin)
        raise
    return finalise_run(fitting, origin)


class TrainingLoop:
    """A run under way."""

    validation: list[tuple[tf.Tensor, tf.Tensor]]
    validated_on: str

    def __init__(
        self,
        config: TrainConfig,
        out: Path,
        learner: Trainer,
        progress: TrainingProgress,
        stream: BatchStream,
    ) -> None:
        self.config, self.out, self.learner = config, out, learner
        self.progress, self.stream, self.task = progress, stream, learner.task

    def run(self, *, show: bool) -> None:
        """Step, validate and save until the end; what was done is kept on Ctrl-C."""
        if self.finished:
            return
        writer = tf.summary.create_file_writer(str(self.out / run_files.TENSORBOARD_FOLDER))
        begun, before = time.monotonic(), self.progress.seconds
        bar: Any = progress_bar(
            self._steps(), initial=self.progress.step, total=self.config.steps, unit="step", disable=not show
        )
        try:
            for step in bar:
                self.progress.seconds = before + time.monotonic() - begun
                if self._owes_validation:
                    row = self._validate()
                    run_directory.log_to_tensorboard(writer, row)
                    bar.set_postfix_str(self._postfix(row))
                if step % self.config.checkpoint_every == 0 or self.finished:
                    self._save()
        except KeyboardInterrupt:
            # Not in the middle of a step, nor before the validation that follows one.
            if int(self.learner.optimizer.iterations) == self.progress.step and not self._owes_validation:
                self._save()
            raise
        finally:
            writer.close()

    @property
    def finished(self) -> bool:
        impatient = 0 < self.config.patience <= self.progress.stale
        return self.progress.step >= self.config.steps or impatient

    @property
    def _owes_validation(self) -> bool:
        """Whether the last step is one to judge the model after, and that is not done."""
        step, history = self.progress.step, self.progress.history
        due = step > 0 and (step % self.config.validate_every == 0 or step == self.config.steps)
        return due and not (history and history[-1]["step"] == step)

    def _steps(self) -> Iterator[int]:
        """Train on one batch at a time, yielding how many steps are done in all."""
        begun: float | None = None  # the first step is mostly tracing: it is not timed
        for images, target in self.stream(self.progress.step * self.config.batch_size):
            loss = float(self.learner.step(images, target))
            if not math.isfinite(loss):
                raise self._diverged(f"the loss is {loss}")
            self.progress.step += 1
            self.progress.loss_sum += loss
            self.progress.loss_count += 1
            if begun is not None:
                self.progress.timed_steps += 1
                self.progress.timed_seconds += time.monotonic() - begun
            yield self.progress.step
            if self.finished:
                return
            begun = time.monotonic()
        raise ValueError(f"the training stream ended after {self.progress.step} of {self.config.steps} steps")

    def _validate(self) -> dict[str, float]:
        """Judge the model on the validation pictures, keep it if it is the best; the history's new row."""
        self.learner.recalibrate(lambda: self._calibration)
        found = self.learner.assess(self.validation)
        figures = self.task.figures(found)
        if not math.isfinite(figures[self.task.score] + found["loss"][0]):
            raise self._diverged("validation gives no numbers")
        row = self._row(found["loss"][0], figures)
        progress, merit = self.progress, self.task.merit(figures)
        if better := progress.best_merit is None or merit > progress.best_merit:
            with atomic_write(self.out / run_files.BEST_MODEL_FILE) as temporary:
                self.learner.model.save(temporary)
        run_directory.write_history(self.out, [*progress.history, row])
        # After the files: what Ctrl-C leaves undone is done again from the checkpoint before.
        progress.stale += 1
        if better:
            progress.best_merit, progress.best_step, progress.stale = merit, progress.step, 0
        progress.loss_sum = progress.timed_seconds = 0.0
        progress.loss_count = progress.timed_steps = 0
        progress.history.append(row)
        return row

    def _row(self, validation_loss: float, figures: dict[str, float]) -> dict[str, float]:
        progress = self.progress
        pictures = progress.timed_steps * self.config.batch_size
        return {
            "step": progress.step,
            "minutes": progress.seconds / 60.0,
            "learning_rate": self._rate(progress.step - 1),
            "train_loss": progress.loss_sum / max(1, progress.loss_count),
            "val_loss": float(validation_loss),
            **{f"val_{name}": figure for name, figure in figures.items()},
            "images_per_s": pictures / progress.timed_seconds if pictures else math.nan,
        }

    def _postfix(self, row: dict[str, float]) -> str:
        return f"{row['images_per_s']:.0f} images/s, {self.task.score} {row[f'val_{self.task.score}']:.4g}"

    def _rate(self, step: int) -> float:
        config = self.config
        schedule = SCHEDULES[config.schedule]
        ends = {"peak": config.learning_rate, "final": config.final_learning_rate, "steps": config.steps}
        return float(schedule(tf.constant(step), **ends))

    def _save(self) -> None:
        run_directory.save_state(self.out, self.progress, self.learner.variables)

    @cached_property
    def _calibration(self) -> list[tf.Tensor]:
        count = -(-_CALIBRATION_PICTURES // self.config.batch_size)
        batches = (images for images, _ in itertools.islice(self.stream(0), count))
        return batch_norm.calibration_batches(batches, _CALIBRATION_PICTURES)

    def _diverged(self, what: str) -> TrainingDiverged:
        step = self.progress.step
        return TrainingDiverged(
            f"training diverged: {what} at step {step + 1}, learning rate {self._rate(step):.3g}; "
            f"start again with a lower --learning-rate in another --out ({self.out} keeps what was reached)"
        )


def finalise_run(fitting: TrainingLoop, origin: str) -> TrainingResult:
    """Judge the best model, write report and figures; what is there already is read."""
    path = fitting.out / run_files.METRICS_FILE
    if not path.is_file():
        write_json(path, summarise_best_model(fitting, origin))
    return TrainingResult(fitting.out, fitting.config, json.loads(path.read_text(encoding="utf-8")))


def summarise_best_model(fitting: TrainingLoop, origin: str) -> dict[str, Any]:
    """The figures of the best model so far, and a report that shows them."""
    config, progress, model = fitting.config, fitting.progress, load_run(fitting.out).model
    found = evaluate_network(model, fitting.task, fitting.validation)
    rates = [row["images_per_s"] for row in progress.history if math.isfinite(row["images_per_s"])]
    figures = {
        "task": config.task,
        **fitting.task.figures(found),
        "n": len(found["error"]),
        "best_step": progress.best_step,
        "steps": progress.step,
        "minutes": progress.seconds / 60.0,
        "images_per_s": float(np.median(rates)) if rates else math.nan,
        "parameters": model.count_params(),
        "weights_origin": origin,
    }
    pictures = [
        _validation_image(fitting, model, found, index)
        for index in run_report.select_best_and_worst(found["error"])
    ]
    run_report.write_report(
        fitting.out,
        config,
        figures,
        progress.history,
        found,
        pictures,
        validated_on=fitting.validated_on,
    )
    return figures


def _validation_image(
    fitting: TrainingLoop, model: keras.Model, found: dict[str, np.ndarray], index: int
) -> run_report.ValidationImage:
    """Picture `index` of the validation set with its figures and, for masks, its two masks."""
    images, targets = fitting.validation[index // len(fitting.validation[0][0])]
    within = index % len(fitting.validation[0][0])
    figures = {
        key: float(values[index]) for key, values in found.items() if len(values) == len(found["error"])
    }
    masks = None
    if fitting.config.task == "mask":
        predicted = model(images[within : within + 1], training=False).numpy()[0, ..., 0] > 0.5
        masks = predicted, targets[within].numpy() > 0
    return run_report.ValidationImage(images[within].numpy(), figures, masks)
