"""Run trials on compiled training steps that are kept: one per network and optimizer, reset for each trial.

Building and tracing a network takes many times as long as a short trial. What differs between the trials of
one compiled step is set as values at run time: initial weights, learning rates, augmentations.
"""

import itertools
import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.models import batch_norm
from laesi_tf.training.initialisation import initialise_network
from laesi_tf.training.optimizers import OPTIMIZERS, optimizer_variables
from laesi_tf.training.schedules import TableSchedule
from laesi_tf.training.tasks import make_task
from laesi_tf.training.trainer import Trainer, TrainingDiverged, train_steps
from sweeps.trials.budget import Budget
from sweeps.trials.search_space import FINAL_RATIO, Point
from sweeps.trials.training_data import Batch, TrainingData

NetworkKey = tuple[str, str]
"""The backbone and the optimizer of a compiled step."""
_INFERENCE_REPEATS = 30
_WARM_START = {"optimizer": "adam", "schedule": "linear", "augmentation": "none"}
"""How the run that a warm start shares is trained: the same for all points, so that it favours none."""


@dataclass(frozen=True)
class TrialOutcome:
    """The result of a trial: MRE in percent, arrays [N] over the validation set, times in seconds."""

    mre: float
    losses: list[float]
    results: dict[str, np.ndarray]
    parameters: int
    steps_s: float
    steps_cpu_s: float
    evaluation_s: float
    images_per_s: float


class TrialRunner:
    """Runs trials within one budget on `data`; initial weights and compiled steps are kept once made."""

    def __init__(self, budget: Budget, data: TrainingData) -> None:
        self.budget, self.data = budget, data
        self.weight_origins: dict[str, str] = {}
        self._networks: dict[NetworkKey, _CompiledNetwork] = {}
        self._initial_weights: dict[tuple[str, int], list[tf.Tensor]] = {}

    def network_key(self, point: Point) -> NetworkKey:
        """Return the key of the compiled step of `point`; points of equal keys share it."""
        return self.budget.config(point, 0).backbone, point.optimizer

    def prepare(self, point: Point, seed: int) -> None:
        """Build and trace the network of `point` unless an earlier trial did."""
        if (point.start, seed) not in self._initial_weights:
            config = self.budget.config(point, seed)
            network, self.weight_origins[point.start] = initialise_network(config)
            self._initial_weights[point.start, seed] = _copy_values(network.variables)
            if self.budget.warm_start_steps:
                self._warm_start(point, seed)
        if self.network_key(point) not in self._networks:
            self._networks[self.network_key(point)] = _CompiledNetwork(self.budget, point)
            self._trace(self._reset(point, seed, point.learning_rate))

    def _warm_start(self, point: Point, seed: int) -> None:
        """Replace the initial weights of the start of `point` by those after a short run from them."""
        shared, steps = Point(point.start, **_WARM_START), self.budget.warm_start_steps
        self.prepare(shared, seed)
        trainer = self._reset(shared, seed, shared.learning_rate, steps=steps)
        batches = self.data.iterate_batches(shared.augmentations, seed)
        for _ in train_steps(trainer, itertools.islice(batches, steps)):
            pass
        self._initial_weights[point.start, seed] = _copy_values(trainer.model.variables)

    def run(
        self,
        point: Point,
        seed: int,
        *,
        learning_rate: float | None = None,
        check_timeout: Callable[[], None] = lambda: None,
        report_steps: Collection[int] = (),
        on_report: Callable[[int, float], None] = lambda step, mre: None,
    ) -> TrialOutcome:
        """Train `point` from its start. Raises TrainingDiverged when the loss or the MRE is not finite.

        `learning_rate` replaces that of the point. `check_timeout` is called before each step, `on_report`
        with the MRE in percent after each of `report_steps`; an exception of either ends the trial.
        """
        self.prepare(point, seed)
        trainer = self._reset(point, seed, learning_rate or point.learning_rate)
        evaluation_s, evaluation_cpu_s = 0.0, 0.0
        losses: list[float] = []
        calibration: list[tf.Tensor] = []
        started, started_cpu = time.perf_counter(), time.process_time()
        stream = itertools.islice(self.data.iterate_batches(point.augmentations, seed), self.budget.steps)
        batches = _check_before_each(stream, check_timeout)
        for step in train_steps(trainer, batches):
            losses.append(step.loss)
            is_silhouette = step.number <= self.budget.silhouette_steps
            if not is_silhouette and len(calibration) * self.budget.batch_size < self.budget.calibration:
                calibration.append(step.images)
            if step.number in report_steps:
                results, spent, cpu = self._evaluate(trainer, calibration)
                evaluation_s, evaluation_cpu_s = evaluation_s + spent, evaluation_cpu_s + cpu
                on_report(step.number, _finite_mre(trainer, results, step.number))
        steps_s = time.perf_counter() - started - evaluation_s
        steps_cpu_s = time.process_time() - started_cpu - evaluation_cpu_s
        results, spent, _ = self._evaluate(trainer, calibration)
        return TrialOutcome(
            mre=_finite_mre(trainer, results, len(losses)),
            losses=losses,
            results=results,
            parameters=trainer.model.count_params(),
            steps_s=steps_s,
            steps_cpu_s=steps_cpu_s,
            evaluation_s=evaluation_s + spent,
            images_per_s=len(losses) * self.budget.batch_size / steps_s,
        )

    def network(self, point: Point) -> keras.Model:
        """Return the network that the last trial with the key of `point` trained."""
        return self._networks[self.network_key(point)].trainer.model

    def measure_inference_ms(self, point: Point) -> float:
        """Return the milliseconds that the network of `point` takes for one image: the minimum of 30 runs.

        Other workers use the same processors; the minimum is the time that the network takes undisturbed.
        """
        infer = self._networks[self.network_key(point)].trainer.predict_step
        image = self.data.validation[0][0][:1]
        infer(image)
        times_ms = []
        for _ in range(_INFERENCE_REPEATS):
            started = time.perf_counter()
            infer(image).numpy()
            times_ms.append(1e3 * (time.perf_counter() - started))
        return min(times_ms)

    def _reset(self, point: Point, seed: int, learning_rate: float, *, steps: int | None = None) -> Trainer:
        """Set the compiled step of `point` to the values that its trial of `steps` starts from."""
        network = self._networks[self.network_key(point)]
        trainer = network.trainer
        _assign_values(trainer.model.variables, self._initial_weights[point.start, seed])
        _assign_values(optimizer_variables(trainer.optimizer), network.optimizer_values)
        network.schedule.set_schedule(
            point.schedule, peak=learning_rate, final=FINAL_RATIO * learning_rate, steps=steps
        )
        return trainer

    def _evaluate(
        self, trainer: Trainer, calibration: list[tf.Tensor]
    ) -> tuple[dict[str, np.ndarray], float, float]:
        """Return the results on the validation images, and the seconds and seconds of CPU time they took."""
        started, started_cpu = time.perf_counter(), time.process_time()
        trainer.recalibrate(lambda: batch_norm.calibration_batches(calibration, self.budget.calibration))
        results = trainer.evaluate(self.data.validation)
        return results, time.perf_counter() - started, time.process_time() - started_cpu

    def _trace(self, trainer: Trainer) -> None:
        """Run one step and one evaluation, so that both are compiled."""
        images, target = next(self.data.iterate_batches((), 0))
        trainer.train_step(images, target)
        self._evaluate(trainer, [images] * -(-self.budget.calibration // len(images)))


class _CompiledNetwork:
    """A compiled training step with the initial values of its optimizer."""

    def __init__(self, budget: Budget, point: Point) -> None:
        config = budget.config(point, 0)
        network, _ = initialise_network(config, origin="set before each trial")
        self.schedule = TableSchedule(max(budget.steps, budget.warm_start_steps))
        self.trainer = Trainer(network, make_task(config), OPTIMIZERS[point.optimizer](self.schedule))
        self.optimizer_values = _copy_values(optimizer_variables(self.trainer.optimizer))


def check_weights(budget: Budget, points: Iterable[Point]) -> None:
    """Raise InputError if the initial weights of one of `points` cannot be had; downloads them if need be."""
    options = {"large_imagenet": "--weights-large", "small_imagenet": "--weights-small"}
    for point in {point.start: point for point in points}.values():
        try:
            initialise_network(budget.config(point, 0))
        except InputError as error:
            option = options[point.start]
            raise InputError(
                f"{point.start}: {str(error).split('; pass')[0]}; "
                f"pass {option} FILE, or {option} none for random weights"
            ) from error


def _copy_values(variables: Iterable[Any]) -> list[tf.Tensor]:
    return [tf.identity(variable) for variable in variables]


def _assign_values(variables: Iterable[Any], values: Iterable[tf.Tensor]) -> None:
    for variable, value in zip(variables, values, strict=True):
        variable.assign(value)


def _check_before_each(batches: Iterable[Batch], check: Callable[[], None]) -> Iterator[Batch]:
    for batch in batches:
        check()
        yield batch


def _finite_mre(trainer: Trainer, results: dict[str, np.ndarray], step: int) -> float:
    mre = trainer.task.aggregate(results)["mre"]
    if not math.isfinite(mre):
        raise TrainingDiverged(f"training diverged: the MRE is {mre} at step {step}")
    return mre
