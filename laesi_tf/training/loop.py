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
from laesi_tf.common.errors import InputError
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
from laesi_tf.training.input_pipeline import InputPipeline
from laesi_tf.training.replicas import ONE_DEVICE, Replicas, Start, WorkerLost
from laesi_tf.training.replicated_trainer import make_trainer
from laesi_tf.training.run_directory import (
    TrainingProgress,
    check_run_directory,
    create_run_directory,
    is_finished,
    log_to_tensorboard,
    record_start,
    restore_state,
    save_state,
)
from laesi_tf.training.run_summary import TrainingResult, load_result, summarise_best_network
from laesi_tf.training.schedules import learning_rate_at
from laesi_tf.training.trainer import (
    Batches,
    BatchStream,
    TrainedStep,
    Trainer,
    TrainingDiverged,
    train_steps,
)
from laesi_tf.training.validation import Validation

STOPPING = "stopping after this step; press Ctrl-C again to stop at once"


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
    replicas: Replicas = ONE_DEVICE,
    validation_name: str = SYNTHETIC_SCENES,
    show_progress: bool = True,
) -> TrainingResult:
    """Train what `config` says into the folder `out`, or continue the run that is there.

    `train` and `validation` replace the live synthetic scenes; `validation` is kept in memory, and the report
    calls it `validation_name`. Scenes are rendered by the data service at `data_service` (HOST:PORT), if
    there is one, or on `synthesis_device` (see `find_synthesis_device`), with the same result. `replicas` are
    the devices that train. Where they are in several processes, this one is the chief, and the others call
    `follow`. Raises InputError for anything that cannot be used, before the first download and the first
    scene; TrainingDiverged where the loss is not finite; WorkerLost where another process ended;
    TrainingInterrupted after Ctrl-C.
    """
    out = Path(out)
    origin, start = _check_start(out, config, replicas)
    if start is Start.FINISHED:
        notify(f"{out} is finished: nothing to train", show=show_progress)
        return load_result(out, config)
    if train is None or validation is None:
        pipeline = InputPipeline(
            config, data_service=data_service, synthesis_device=synthesis_device, replicas=replicas
        )
        validation = pipeline.validation_batches() if validation is None else validation
    parts = pipeline.training_batches if train is None else replicas.take_part(train)
    whole = pipeline.whole_batches if train is None else train
    started = origin if (out / STATE_FILE).is_file() else None
    trainer, origin = make_trainer(config, replicas, origin=started)
    with replicas.scope():
        progress = restore_state(out, trainer.variables)
    replicas.share_variables(trainer.variables)
    loop = TrainingLoop(
        config, out, trainer, progress, parts, list(validation), replicas=replicas, whole_batches=whole
    )
    if started is None:
        create_run_directory(out, config, origin, replicas.describe())
    else:
        record_start(out, config, replicas.describe())
        notify(f"continuing from step {progress.step} of {config.steps}", show=show_progress)

    def summarise() -> dict[str, Any]:
        metrics = summarise_best_network(
            out, config, progress, loop.validation, weights_origin=origin, validation_name=validation_name
        )
        return metrics | replicas.describe()

    replicas.share_progress(progress.step, is_finished=loop.is_finished)
    try:
        loop.run(show_progress=show_progress)
    except TrainingInterrupted:
        if progress.history:
            summarise()
        raise
    write_json(out / METRICS_FILE, summarise())
    return load_result(out, config)


def _check_start(out: Path, config: TrainConfig, replicas: Replicas) -> tuple[str | None, Start]:
    """Return what `check_run_directory` returns, and what to do, which the other processes get."""
    try:
        origin = check_run_directory(out, config)
        finished = is_finished(out, config)
        if not finished:
            require_writable(out / CONFIG_FILE)
    except InputError:
        replicas.share_start(Start.REFUSED, config)
        raise
    start = Start.FINISHED if finished else Start.TRAIN
    replicas.share_start(start, config)
    return origin, start


class TrainingLoop:
    """A run in progress: `stream` yields what this process trains on, `whole_batches` all of each batch."""

    def __init__(
        self,
        config: TrainConfig,
        out: Path,
        trainer: Trainer,
        progress: TrainingProgress,
        stream: BatchStream,
        validation: list[tuple[tf.Tensor, tf.Tensor]],
        *,
        replicas: Replicas = ONE_DEVICE,
        whole_batches: BatchStream | None = None,
    ) -> None:
        self.config, self.out, self.trainer = config, out, trainer
        self.progress, self.stream, self.validation = progress, stream, validation
        self._replicas = replicas
        self._validator = Validation(config, out, trainer, validation, whole_batches or stream)
        self._saved_step = progress.step
        self._iterations = self._count_iterations()

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
            with defer_interrupt(lambda: notify(STOPPING, show=show_progress)) as stop_requested:
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
                is_finished, is_stopped = self._replicas.agree(
                    is_finished=self.is_finished, is_stopped=stop_requested()
                )
                if is_finished:
                    return
                if is_stopped:
                    self._save()
                    raise KeyboardInterrupt
                step_started = time.monotonic()
        except TrainingDiverged as error:
            raise self._add_advice(str(error)) from None
        except WorkerLost as error:
            raise WorkerLost(
                f"{error} after step {progress.step}; saved up to step {self._saved_step}. Start all workers "
                "again with the same commands, or the run without --strategy on this machine"
            ) from error
        raise ValueError(f"the training stream ended after {progress.step} of {self.config.steps} steps")

    def _count(self, step: TrainedStep, started: float | None) -> None:
        """Count a step, and its time since `started`; the first step is mostly tracing and has none."""
        progress = self.progress
        progress.step = step.number
        self._iterations = self._count_iterations()
        progress.loss_sum += step.loss
        progress.loss_count += 1
        if started is not None:
            progress.timed_steps += 1
            progress.timed_seconds += time.monotonic() - started

    def _validate(self) -> dict[str, float]:
        """Validate the network after the last step; return the history's new row."""
        return self._validator.run(self.progress)

    def _format_progress(self) -> str:
        """Return the mean loss since the last validation, and what that validation found."""
        text = f"loss {self.progress.mean_loss:.4g}"
        if not self.progress.history:
            return text
        row, metric = self.progress.history[-1], self.trainer.task.main_metric
        return f"{text}, {metric} {row[f'val_{metric}']:.4g}, {row['images_per_s']:.0f} images/s"

    def _count_iterations(self) -> int:
        """Return how often weights changed: not in every step, as scaling of the loss leaves some out."""
        return int(self.trainer.optimizer.iterations.numpy())

    def _save(self) -> None:
        save_state(self.out, self.progress, self.trainer.variables)
        self._saved_step = self.progress.step

    def _interrupt(self) -> TrainingInterrupted:
        """Save the state if it is that of a whole step with its validation; return what to tell the user."""
        step = self.progress.step
        is_whole = self._count_iterations() == self._iterations and not self._validation_is_due
        if self._saved_step < step and is_whole:
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


def notify(message: str, *, show: bool = True) -> None:
    """Write a line to stderr, above a progress bar, unless `show` says no."""
    if show:
        tqdm.write(message, file=sys.stderr)
