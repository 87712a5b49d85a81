"""Train a network into a run directory: steps, validation, checkpoints, and continuation after a stop.

Step k always gets samples k * batch_size up to (k + 1) * batch_size of its stream, so a run that was stopped
continues on the same curve as one that was not.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tensorflow as tf
from tqdm import tqdm

from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.interrupts import defer_interrupt
from laesi_tf.common.progress import progress_bar
from laesi_tf.common.run_files import (
    CONFIG_FILE,
    METRICS_FILE,
    STATE_FILE,
    TENSORBOARD_FOLDER,
)
from laesi_tf.reporting.run_report import SYNTHETIC_SCENES
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.device_synthesis import AUTO
from laesi_tf.training.initialisation import initialise_network
from laesi_tf.training.input_pipeline import BatchStream, InputPipeline
from laesi_tf.training.optimizers import make_optimizer
from laesi_tf.training.run_directory import (
    TrainingProgress,
    check_run_directory,
    create_run_directory,
    is_finished,
    log_to_tensorboard,
    record_steps,
    restore_state,
    save_state,
)
from laesi_tf.training.run_summary import TrainingResult, load_result, summarise_best_network
from laesi_tf.training.schedules import learning_rate_at
from laesi_tf.training.tasks import make_task
from laesi_tf.training.trainer import Batches, TrainedStep, Trainer, TrainingDiverged, train_steps
from laesi_tf.training.validation import Validation

_STOPPING = "stopping after this step; press Ctrl-C again to stop at once"


class TrainingInterrupted(KeyboardInterrupt):
    """Ctrl-C during training; the message says what was saved."""


def fit(
    config: TrainConfig,
    out: Path | str,
    *,
    train: BatchStream | None = None,
    validation: Batches | None = None,
    data_service: str = "",
    synthesis_device: str = AUTO,
    validation_name: str = SYNTHETIC_SCENES,
    show_progress: bool = True,
) -> TrainingResult:
    """Train what `config` says into the folder `out`, or continue the run that is there.

    `train` and `validation` replace the live synthetic scenes; `validation` is kept in memory, and the report
    calls it `validation_name`. Scenes are rendered by the data service at `data_service` (HOST:PORT), if
    there is one, or on `synthesis_device` (see `find_synthesis_device`), with the same result. Raises
    InputError for anything that cannot be used, before the first download and the first scene;
    TrainingDiverged where the loss is not finite; TrainingInterrupted after Ctrl-C.
    """
    out = Path(out)
    origin = check_run_directory(out, config)
    if is_finished(out, config):
        _notify(f"{out} is finished: nothing to train", show=show_progress)
        return load_result(out, config)
    require_writable(out / CONFIG_FILE)
    if train is None or validation is None:
        pipeline = InputPipeline(config, data_service=data_service, synthesis_device=synthesis_device)
        train = train or pipeline.training_batches
        validation = pipeline.validation_batches() if validation is None else validation
    started = origin if (out / STATE_FILE).is_file() else None
    model, origin = initialise_network(config, origin=started)
    optimizer = make_optimizer(
        config.optimizer,
        schedule=config.schedule,
        peak=config.learning_rate,
        final=config.final_learning_rate,
        steps=config.steps,
    )
    trainer = Trainer(model, make_task(config), optimizer)
    progress = restore_state(out, trainer.variables)
    loop = TrainingLoop(config, out, trainer, progress, train, list(validation))
    if started is None:
        create_run_directory(out, config, origin)
    else:
        record_steps(out, config)
        _notify(f"continuing from step {progress.step} of {config.steps}", show=show_progress)

    def summarise() -> dict[str, Any]:
        return summarise_best_network(
            out, config, progress, loop.validation, weights_origin=origin, validation_name=validation_name
        )

    try:
        loop.run(show_progress=show_progress)
    except TrainingInterrupted:
        if progress.history:
            summarise()
        raise
    write_json(out / METRICS_FILE, summarise())
    return load_result(out, config)


class TrainingLoop:
    """A run in progress."""

    def __init__(
        self,
        config: TrainConfig,
        out: Path,
        trainer: Trainer,
        progress: TrainingProgress,
        stream: BatchStream,
        validation: list[tuple[tf.Tensor, tf.Tensor]],
    ) -> None:
        self.config, self.out, self.trainer = config, out, trainer
        self.progress, self.stream, self.validation = progress, stream, validation
        self._validation = Validation(config, out, trainer, validation, stream)
        self._saved_step = progress.step

    def run(self, *, show_progress: bool) -> None:
        """Train, validate and save until the end. Raises TrainingInterrupted after Ctrl-C."""
        if self.is_finished:
            return
        writer = tf.summary.create_file_writer(str(self.out / TENSORBOARD_FOLDER))
        # The time left comes from the average rate of steps alone: a moving rate, or one with the pauses for
        # tracing and validation, makes it jump.
        bar = progress_bar(
            [],
            initial=self.progress.step,
            total=self.config.steps,
            unit="step",
            smoothing=0,
            miniters=1,
            disable=not show_progress,
        )
        try:
            with defer_interrupt(lambda: _notify(_STOPPING, show=show_progress)) as stop_requested:
                self._train(writer, bar, stop_requested)
        except KeyboardInterrupt:
            raise self._interrupt() from None
        finally:
            bar.close()
            writer.close()

    @property
    def is_finished(self) -> bool:
        """Whether all steps are done, or validations no longer improve."""
        out_of_patience = 0 < self.config.patience <= self.progress.stale
        return self.progress.step >= self.config.steps or out_of_patience

    @property
    def _validation_is_due(self) -> bool:
        """Whether the network is to be validated after the last step, and has not been."""
        step, history = self.progress.step, self.progress.history
        due = step > 0 and (step % self.config.validate_every == 0 or step == self.config.steps)
        return due and not (history and history[-1]["step"] == step)

    def _train(
        self, writer: tf.summary.SummaryWriter, bar: "tqdm[Any]", stop_requested: Callable[[], bool]
    ) -> None:
        progress, started, seconds_before = self.progress, time.monotonic(), self.progress.seconds
        step_started: float | None = None
        try:
            for step in train_steps(
                self.trainer,
                self.stream(progress.step * self.config.batch_size),
                steps_done=progress.step,
            ):
                self._count(step, step_started)
                progress.seconds = seconds_before + time.monotonic() - started
                if step_started is None:
                    bar.unpause()  # the first step is mostly tracing
                bar.set_postfix_str(self._format_progress(), refresh=False)
                bar.update()
                if self._validation_is_due:
                    log_to_tensorboard(writer, self._validate())
                    bar.unpause()
                if step.number % self.config.checkpoint_every == 0 or self.is_finished:
                    self._save()
                if self.is_finished:
                    return
                if stop_requested():
                    raise KeyboardInterrupt
                step_started = time.monotonic()
        except TrainingDiverged as error:
            raise self._add_advice(str(error)) from None
        raise ValueError(f"the training stream ended after {progress.step} of {self.config.steps} steps")

    def _count(self, step: TrainedStep, started: float | None) -> None:
        """Count a step, and its time since `started`; the first step is mostly tracing and has none."""
        progress = self.progress
        progress.step = step.number
        progress.loss_sum += step.loss
        progress.loss_count += 1
        if started is not None:
            progress.timed_steps += 1
            progress.timed_seconds += time.monotonic() - started

    def _validate(self) -> dict[str, float]:
        """Validate the network after the last step; return the history's new row."""
        return self._validation.run(self.progress)

    def _format_progress(self) -> str:
        """Return the mean loss since the last validation, and what that validation found."""
        text = f"loss {self.progress.mean_loss:.4g}"
        if not self.progress.history:
            return text
        row, metric = self.progress.history[-1], self.trainer.task.main_metric
        return f"{text}, {metric} {row[f'val_{metric}']:.4g}, {row['images_per_s']:.0f} images/s"

    def _save(self) -> None:
        save_state(self.out, self.progress, self.trainer.variables)
        self._saved_step = self.progress.step

    def _interrupt(self) -> TrainingInterrupted:
        """Save the state if it is that of a whole step with its validation; return what to tell the user."""
        step = self.progress.step
        if int(self.trainer.optimizer.iterations) == step and not self._validation_is_due:
            self._save()
        if self._saved_step == step:
            return TrainingInterrupted(f"stopped at step {step}, saved; the same command continues")
        return TrainingInterrupted(
            f"stopped at step {step}, saved up to step {self._saved_step}; "
            "the same command continues from there"
        )

    def _add_advice(self, reason: str) -> TrainingDiverged:
        rate = learning_rate_at(self.progress.step, self.config)
        return TrainingDiverged(
            f"{reason}, learning rate {rate:.3g}; start again with a lower --learning-rate in another --out "
            f"({self.out} keeps what was reached)"
        )


def _notify(message: str, *, show: bool) -> None:
    if show:
        tqdm.write(message, file=sys.stderr)
