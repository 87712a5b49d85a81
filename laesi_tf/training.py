"""The one training loop, which train, experiments and sweeps share.

Step k is fed pictures k * batch_size up to (k + 1) * batch_size of its stream, whatever happened before, so a
run that was killed continues with the same curve as one that was not.
"""

import itertools
import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import keras
import numpy as np
import tensorflow as tf

from laesi_tf import report, runs
from laesi_tf.cli import progress as progress_bar
from laesi_tf.config import TrainConfig
from laesi_tf.data import augmentation, augmentation_ops, mixture, synthetic, tf_data_service
from laesi_tf.data.leaf_textures import load_textures
from laesi_tf.errors import InputError
from laesi_tf.files import whole, write_json
from laesi_tf.learner import Batches, Learner, assessed
from laesi_tf.models import batch_norm
from laesi_tf.models.backbone import FROM_SCRATCH, build_backbone
from laesi_tf.runs import Progress, Run, load_run
from laesi_tf.schedules import SCHEDULES, optimizer
from laesi_tf.synthesis import load_ranges
from laesi_tf.tasks import Task, task

__all__ = ["Diverged", "Result", "Run", "assess", "build", "fit", "load_run"]

# From the index of the first picture to an endless stream of batches.
Stream = Callable[[int], Batches]

_CALIBRATION_PICTURES = 512
"""Batch normalisation is recalibrated on this many pictures."""
_VALIDATION_SEED = 0


class Diverged(InputError):
    """The loss stopped being a number: the configuration asks too much of the optimizer."""


@dataclass(frozen=True)
class Result:
    """A finished run and the figures in its metrics.json."""

    path: Path
    config: TrainConfig
    metrics: dict[str, Any]


def fit(
    config: TrainConfig,
    out: Path | str,
    *,
    train: Stream | None = None,
    validation: Batches | None = None,
    data_service: str = "",
    validated_on: str = report.SCENES,
    show: bool = True,
) -> Result:
    """Train what `config` says into the folder `out`, or continue the run that is there.

    `train` and `validation` replace the live synthetic scenes; `validation` is held in memory, and the report
    calls it `validated_on`. `data_service` HOST:PORT has the scenes made elsewhere, with the same result.
    `show` draws a progress bar. Raises InputError for a folder that holds something else and Diverged when
    the loss is NaN.
    """
    out = Path(out)
    origin = runs.origin_of(out, config)
    started = origin if (out / runs.STATE).is_file() else None
    model, origin = build(config, origin=started)
    follower = optimizer(
        config.optimizer,
        schedule=config.schedule,
        peak=config.learning_rate,
        final=config.final_learning_rate,
        steps=config.steps,
    )
    learner = Learner(model, task(config), follower)
    progress = runs.load_state(out, learner.variables)
    fitting = _Fitting(config, out, learner, progress, train or _training(config, data_service))
    fitting.validation = list(_synthetic_validation(config) if validation is None else validation)
    fitting.validated_on = validated_on
    if started is None:
        runs.begin(out, config, origin)
    try:
        fitting.run(show=show)
    except KeyboardInterrupt:
        if progress.history:
            _figures(fitting, origin)
        raise
    return _finish(fitting, origin)


def build(config: TrainConfig, *, origin: str | None = None) -> tuple[keras.Model, str]:
    """A new network and its weights' origin; with an `origin`, one whose weights are about to be restored.

    Batch normalisation is frozen as `config` has it. Two calls with the same seed give the same network.
    """
    keras.utils.set_random_seed(config.seed)
    weights = config.weights if origin is None else FROM_SCRATCH
    base, found = build_backbone(config.backbone, size=config.size, alpha=config.alpha, weights=weights)
    origin = origin or found
    if config.batch_norm == "frozen" and origin == FROM_SCRATCH:
        raise InputError("batch_norm frozen needs pretrained weights; choose recalibrated")
    if config.batch_norm == "frozen":
        batch_norm.freeze(base)
    return task(config).build(base), origin


def assess(model: keras.Model, judged: Task, batches: Batches) -> dict[str, np.ndarray]:
    """What `judged` says of every picture in `batches`, [N] per key; and "loss", their mean [1]."""
    return assessed(tf.function(lambda images: model(images, training=False)), judged, batches)


class _Fitting:
    """A run under way."""

    validation: list[tuple[tf.Tensor, tf.Tensor]]
    validated_on: str

    def __init__(
        self,
        config: TrainConfig,
        out: Path,
        learner: Learner,
        progress: Progress,
        stream: Stream,
    ) -> None:
        self.config, self.out, self.learner = config, out, learner
        self.progress, self.stream, self.task = progress, stream, learner.task

    def run(self, *, show: bool) -> None:
        """Step, validate and save until the end; what was done is kept on Ctrl-C."""
        if self.finished:
            return
        writer = tf.summary.create_file_writer(str(self.out / runs.TENSORBOARD))
        begun, before = time.monotonic(), self.progress.seconds
        bar: Any = progress_bar(
            self._steps(), initial=self.progress.step, total=self.config.steps, unit="step", disable=not show
        )
        try:
            for step in bar:
                self.progress.seconds = before + time.monotonic() - begun
                if self._owes_validation:
                    row = self._validate()
                    runs.log(writer, row)
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
            with whole(self.out / runs.BEST) as temporary:
                self.learner.model.save(temporary)
        runs.write_history(self.out, [*progress.history, row])
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
        runs.save_state(self.out, self.progress, self.learner.variables)

    @cached_property
    def _calibration(self) -> list[tf.Tensor]:
        count = -(-_CALIBRATION_PICTURES // self.config.batch_size)
        batches = (images for images, _ in itertools.islice(self.stream(0), count))
        return batch_norm.calibration_batches(batches, _CALIBRATION_PICTURES)

    def _diverged(self, what: str) -> Diverged:
        step = self.progress.step
        return Diverged(
            f"training diverged: {what} at step {step + 1}, learning rate {self._rate(step):.3g}; "
            f"start again with a lower --learning-rate in another --out ({self.out} keeps what was reached)"
        )


def _finish(fitting: _Fitting, origin: str) -> Result:
    """Judge the best model, write report and figures; what is there already is read."""
    path = fitting.out / runs.METRICS
    if not path.is_file():
        write_json(path, _figures(fitting, origin))
    return Result(fitting.out, fitting.config, json.loads(path.read_text(encoding="utf-8")))


def _figures(fitting: _Fitting, origin: str) -> dict[str, Any]:
    """The figures of the best model so far, and a report that shows them."""
    config, progress, model = fitting.config, fitting.progress, load_run(fitting.out).model
    found = assess(model, fitting.task, fitting.validation)
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
    pictures = [_picture(fitting, model, found, index) for index in report.chosen(found["error"])]
    report.write(
        fitting.out,
        config,
        figures,
        progress.history,
        found,
        pictures,
        validated_on=fitting.validated_on,
    )
    return figures


def _picture(
    fitting: _Fitting, model: keras.Model, found: dict[str, np.ndarray], index: int
) -> report.Picture:
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
    return report.Picture(images[within].numpy(), figures, masks)


def _training(config: TrainConfig, data_service: str) -> Stream:
    """The stream that `config` names: live scenes or a mixture, augmented or not.

    Live scenes are made by the `data_service` at that address where there is one.
    """
    batch_size = config.batch_size
    if config.mixture and data_service:
        raise InputError("--data-service makes live scenes only; leave out --data-service or --mixture")
    textures = load_textures(config.textures) if config.textures else None
    sources = _sources(config, textures)
    ranges = load_ranges(config.ranges)

    def live(places: tf.data.Dataset) -> tf.data.Dataset:
        # Runs of places are whole: a batch has so many leaves.
        passes = config.lighting_passes
        first = places.filter(lambda place: place % passes == 0)
        scenes = synthetic.samples_of_leaves(
            first.map(lambda place: (place + synthetic.TRAIN_INDICES[0]) // passes),
            seed=config.seed,
            size=config.size,
            ranges=ranges,
            passes=passes,
            textures=textures,
        )
        return _examples(
            scenes.map(lambda scene: (scene["index"] - synthetic.TRAIN_INDICES[0], scene)), config
        )

    def stream(start: int) -> Batches:
        if data_service:
            return tf_data_service.receive_batches(live, data_service, batch_size=batch_size, start=start)
        if sources:
            mixed = mixture.mix_sources(sources, seed=config.seed, start=start)
            examples = _examples(mixed.enumerate(start), config)
        else:
            examples = live(tf.data.Dataset.range(start, synthetic.TRAIN_INDICES[1]))
        return examples.map(lambda _, example: example).batch(batch_size).prefetch(2)

    return stream


def _examples(numbered: tf.data.Dataset, config: TrainConfig) -> tf.data.Dataset:
    """(place, (image, target)) of a stream of (place, picture), augmented as `config` says."""
    task_name = cast(synthetic.TaskName, config.task)
    switched = augmentation.augmentation_flags(augmentation.parse_augmentations(config.augment))

    def augmented(
        place: tf.Tensor, picture: augmentation_ops.Sample
    ) -> tuple[tf.Tensor, augmentation_ops.Sample]:
        return place, augmentation.augment_sample(
            picture, tf.stack([config.seed, place]), tf.constant(switched)
        )

    if switched.any():
        numbered = numbered.map(augmented, num_parallel_calls=tf.data.AUTOTUNE)
    return numbered.map(lambda place, picture: (place, synthetic.make_example(picture, task_name)))


def _sources(config: TrainConfig, textures: tf.Tensor | None) -> list[mixture.Source]:
    if not config.mixture:
        return []
    if config.lighting_passes != 1:
        raise InputError("a mixture has one light for each leaf; leave out --lighting-passes or --mixture")
    return mixture.load_mixture(
        config.mixture,
        size=config.size,
        seed=config.seed,
        masked=config.task == "mask",
        ranges=config.ranges,
        textures=textures,
    )


def _synthetic_validation(config: TrainConfig) -> Batches:
    # One seed for all runs: their scores compare. The range of indices keeps it apart from training.
    return synthetic.synthetic_batches(
        task=cast(synthetic.TaskName, config.task),
        batch_size=config.batch_size,
        seed=_VALIDATION_SEED,
        size=config.size,
        ranges=config.ranges,
        start=synthetic.VALIDATION_INDICES[0],
        count=config.validation_pictures,
        passes=1,
        textures=load_textures(config.textures) if config.textures else None,
    )
