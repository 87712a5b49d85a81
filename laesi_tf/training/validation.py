"""Validate a run: recalibrate and evaluate its network, keep the best one, add a row to the history."""

import itertools
import math
from functools import cached_property
from pathlib import Path

import tensorflow as tf

from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.common.run_files import BEST_MODEL_FILE
from laesi_tf.models import batch_norm
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.run_directory import TrainingProgress, write_history
from laesi_tf.training.schedules import learning_rate_at
from laesi_tf.training.trainer import BatchStream, Trainer, TrainingDiverged

_CALIBRATION_IMAGES = 512
"""Batch normalisation is recalibrated on this many training images."""


class Validation:
    """The validations of a run: on the batches `validation`, recalibrated on the first images of `stream`."""

    def __init__(
        self,
        config: TrainConfig,
        out: Path,
        trainer: Trainer,
        validation: list[tuple[tf.Tensor, tf.Tensor]],
        stream: BatchStream,
    ) -> None:
        self._config, self._out, self._trainer = config, out, trainer
        self._validation, self._stream = validation, stream

    def run(self, progress: TrainingProgress) -> dict[str, float]:
        """Evaluate the network, keep it if it is the best so far; return the history's new row."""
        self._trainer.recalibrate(lambda: self._calibration_batches)
        arrays, task = self._trainer.evaluate(self._validation), self._trainer.task
        metrics, loss = task.aggregate(arrays), float(arrays["loss"][0])
        if not math.isfinite(metrics[task.main_metric] + loss):
            raise TrainingDiverged(
                f"training diverged: the validation metrics are not finite at step {progress.step}"
            )
        row, ranking_score = self._make_row(progress, loss, metrics), task.ranking_score(metrics)
        is_best = progress.best_merit is None or ranking_score > progress.best_merit
        if is_best:
            with atomic_write(self._out / BEST_MODEL_FILE) as temporary:
                self._trainer.model.save(temporary)
        write_history(self._out, [*progress.history, row])
        # Progress changes after the files: a validation that Ctrl-C cuts short is repeated from the last
        # checkpoint.
        progress.stale += 1
        if is_best:
            progress.best_merit, progress.best_step, progress.stale = ranking_score, progress.step, 0
        progress.loss_sum = progress.timed_seconds = 0.0
        progress.loss_count = progress.timed_steps = 0
        progress.history.append(row)
        return row

    def _make_row(
        self, progress: TrainingProgress, validation_loss: float, metrics: dict[str, float]
    ) -> dict[str, float]:
        images = progress.timed_steps * self._config.batch_size
        return {
            "step": progress.step,
            "minutes": progress.seconds / 60.0,
            "learning_rate": learning_rate_at(progress.step - 1, self._config),
            "train_loss": progress.mean_loss,
            "val_loss": validation_loss,
            **{f"val_{name}": value for name, value in metrics.items()},
            "images_per_s": images / progress.timed_seconds if images else math.nan,
        }

    @cached_property
    def _calibration_batches(self) -> list[tf.Tensor]:
        count = -(-_CALIBRATION_IMAGES // self._config.batch_size)
        batches = (images for images, _ in itertools.islice(self._stream(0), count))
        return batch_norm.calibration_batches(batches, _CALIBRATION_IMAGES)
