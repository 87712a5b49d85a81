"""Trials on compiled steps that are kept: one per network and optimizer, reset for each trial.

Building and tracing a network takes many times as long as a short trial. What differs between the trials on
one step is set as values at run time: the weights it starts from, the rates of the schedule, the
augmentations.
"""

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.models import batch_norm
from laesi_tf.training.initialisation import initialise_network
from laesi_tf.training.optimizers import OPTIMIZERS, optimizer_variables
from laesi_tf.training.schedules import TableSchedule
from laesi_tf.training.tasks import make_task
from laesi_tf.training.trainer import Trainer, TrainingDiverged
from sweeps.trials.budget import Budget
from sweeps.trials.search_space import FINAL_LEARNING_RATE, LEARNING_RATE, Point
from sweeps.trials.training_data import TrainingData

NetworkKey = tuple[str, str]
"""What a compiled step is for: the network's kind and the optimizer."""
_TIMED_INFERENCES = 30


@dataclass(frozen=True)
class TrialOutcome:
    """What a trial gave: `found` are arrays [N] over the validation set, times are in seconds."""

    mre: float
    losses: list[float]
    found: dict[str, np.ndarray]
    parameters: int
    steps_s: float
    steps_cpu_s: float
    judging_s: float
    images_per_s: float


class TrialRunner:
    """Runs trials within one budget on `pictures`. Initial weights and compiled steps are kept once made."""

    def __init__(self, budget: Budget, pictures: TrainingData) -> None:
        self.budget, self.pictures = budget, pictures
        self.origins: dict[str, str] = {}
        self._kept: dict[NetworkKey, _CompiledNetwork] = {}
        self._starts: dict[tuple[str, int], list[tf.Tensor]] = {}

    def key(self, point: Point) -> NetworkKey:
        """Which compiled step `point` is trained with: points of equal keys share it."""
        return self.budget.config(point, 0).backbone, point.optimizer

    def prepare(self, point: Point, seed: int) -> None:
        """Build and trace what `point` needs, if no trial before did."""
        if (point.start, seed) not in self._starts:
            model, self.origins[point.start] = initialise_network(self.budget.config(point, seed))
            self._starts[point.start, seed] = _copy_values(model.variables)
        if self.key(point) not in self._kept:
            self._kept[self.key(point)] = _CompiledNetwork(self.budget, point)
            self._reset(point, seed)
            self._traced(self._kept[self.key(point)].learner)

    def run(
        self,
        point: Point,
        seed: int,
        *,
        alive: Callable[[], None] = lambda: None,
        rungs: Iterable[int] = (),
        reached: Callable[[int, float], None] = lambda step, mre: None,
    ) -> TrialOutcome:
        """Train `point` from its start. Raises training.Diverged when the loss or the result is no number.

        `alive` is called before each step and `reached` with the MRE after each of the steps `rungs`; what
        they raise ends the trial.
        """
        self.prepare(point, seed)
        learner = self._reset(point, seed)
        judged_at, judging_s, judging_cpu_s = set(rungs), 0.0, 0.0
        losses: list[float] = []
        fed: list[tf.Tensor] = []
        begun, used = time.perf_counter(), time.process_time()
        for step, (images, target) in enumerate(self.pictures.training(point.augmentations, seed), 1):
            alive()
            losses.append(_require_finite(float(learner.train_step(images, target)), step))
            if len(fed) * self.budget.batch_size < self.budget.calibration:
                fed.append(images)
            if step in judged_at:
                found, spent, cpu = self._judged(learner, fed)
                judging_s, judging_cpu_s = judging_s + spent, judging_cpu_s + cpu
                reached(step, _require_finite(learner.task.aggregate(found)["mre"], step))
        steps_s = time.perf_counter() - begun - judging_s
        steps_cpu_s = time.process_time() - used - judging_cpu_s
        found, spent, _ = self._judged(learner, fed)
        return TrialOutcome(
            mre=_require_finite(learner.task.aggregate(found)["mre"], len(losses)),
            losses=losses,
            found=found,
            parameters=learner.model.count_params(),
            steps_s=steps_s,
            steps_cpu_s=steps_cpu_s,
            judging_s=judging_s + spent,
            images_per_s=len(losses) * self.budget.batch_size / steps_s,
        )

    def model(self, point: Point) -> keras.Model:
        """The network that the last trial with the key of `point` trained."""
        return self._kept[self.key(point)].learner.model

    def inference_ms(self, point: Point) -> float:
        """Milliseconds that the network of `point` takes for one picture: the least of several times.

        Other workers have the same processors; the least is what the network takes undisturbed.
        """
        infer, one = self._kept[self.key(point)].learner.predict_step, self.pictures.validation[0][0][:1]
        infer(one)
        spent = []
        for _ in range(_TIMED_INFERENCES):
            begun = time.perf_counter()
            infer(one).numpy()
            spent.append(1e3 * (time.perf_counter() - begun))
        return min(spent)

    def _reset(self, point: Point, seed: int) -> Trainer:
        kept = self._kept[self.key(point)]
        _assign_values(kept.learner.model.variables, self._starts[point.start, seed])
        _assign_values(optimizer_variables(kept.learner.optimizer), kept.optimizer_values)
        kept.rates.set_schedule(point.schedule, peak=LEARNING_RATE, final=FINAL_LEARNING_RATE)
        return kept.learner

    def _judged(self, learner: Trainer, fed: list[tf.Tensor]) -> tuple[dict[str, np.ndarray], float, float]:
        """What the validation pictures give, and the seconds and seconds of CPU time it took."""
        begun, used = time.perf_counter(), time.process_time()
        learner.recalibrate(lambda: batch_norm.calibration_batches(fed, self.budget.calibration))
        found = learner.evaluate(self.pictures.validation)
        return found, time.perf_counter() - begun, time.process_time() - used

    def _traced(self, learner: Trainer) -> None:
        """One step and one judgement, for what they leave compiled."""
        images, target = next(self.pictures.training((), 0))
        learner.train_step(images, target)
        self._judged(learner, [images] * -(-self.budget.calibration // len(images)))


class _CompiledNetwork:
    """A compiled step with what its optimizer starts from."""

    def __init__(self, budget: Budget, point: Point) -> None:
        config = budget.config(point, 0)
        model, _ = initialise_network(config, origin="values that are about to be set")
        self.rates = TableSchedule(budget.steps)
        self.learner = Trainer(model, make_task(config), OPTIMIZERS[point.optimizer](self.rates))
        self.optimizer_values = _copy_values(optimizer_variables(self.learner.optimizer))


def _copy_values(variables: Iterable[Any]) -> list[tf.Tensor]:
    return [tf.identity(variable) for variable in variables]


def _assign_values(variables: Iterable[Any], values: Iterable[tf.Tensor]) -> None:
    for variable, value in zip(variables, values, strict=True):
        variable.assign(value)


def _require_finite(value: float, step: int) -> float:
    if not math.isfinite(value):
        raise TrainingDiverged(f"training diverged: {value} at step {step}")
    return value
