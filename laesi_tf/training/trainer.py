"""A network with its optimizer: compiled steps, and the loop over steps that every training here shares."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.models import batch_norm
from laesi_tf.training.optimizers import optimizer_variables
from laesi_tf.training.tasks.base import Array, Task

Batches = Iterable[tuple[tf.Tensor, tf.Tensor]]
"""Images uint8 [B, H, W, 3] with the targets of a task, as `laesi_tf.data.synthetic` makes them."""
BatchStream = Callable[[int], Batches]
"""From the index of the first sample to an endless stream of batches."""


class TrainingDiverged(InputError):
    """The loss is no longer a finite number: the learning rate is too high for the optimizer."""


class TrainedStep(NamedTuple):
    """One step of training: its number from 1 on, its images, and their mean loss before it."""

    number: int
    images: tf.Tensor
    loss: float


class Trainer:
    """A network with its optimizer: training, inference and recalibration steps, each traced once.

    One trainer serves any number of runs: `variables` are all that training changes, so setting them to
    earlier values starts another run without tracing again.
    """

    def __init__(self, model: keras.Model, task: Task, optimizer: keras.optimizers.Optimizer) -> None:
        self.model, self.task, self.optimizer = model, task, optimizer
        optimizer.build(model.trainable_variables)
        # It sets the layers' momentum, so it is made before the training step is traced.
        self.recalibrate = batch_norm.make_recalibrator(model)
        self.predict_step = tf.function(lambda images: model(images, training=False))
        self.train_step: Callable[[tf.Tensor, tf.Tensor], tf.Tensor] = tf.function(self._train_step)

    @property
    def variables(self) -> list[Any]:
        """The network's variables, then the optimizer's; the order is the same for equal configurations."""
        return [*self.model.variables, *optimizer_variables(self.optimizer)]

    def evaluate(self, batches: Batches) -> dict[str, Array]:
        """Return the task's arrays over all images of `batches`, [N] by name, and "loss", their mean, [1]."""
        return evaluate_batches(self.predict_step, self.task, batches)

    def _train_step(self, images: tf.Tensor, target: tf.Tensor) -> tf.Tensor:
        """Update the network on one batch; return the loss before the update, a scalar."""
        with tf.GradientTape() as tape:
            loss = self._loss(self.model(images, training=True), target)
            scaled_loss = self.optimizer.scale_loss(loss)
        variables = self.model.trainable_variables
        self.optimizer.apply(self._reduce(tape.gradient(scaled_loss, variables)), variables)
        return loss

    def _loss(self, output: tf.Tensor, target: tf.Tensor) -> tf.Tensor:
        return self.task.loss(output, target)

    def _reduce(self, gradients: list[tf.Tensor]) -> list[tf.Tensor]:
        """Return the gradients of the whole batch; a trainer on several devices has more to do."""
        return gradients


def train_steps(trainer: Trainer, batches: Batches, *, steps_done: int = 0) -> Iterator[TrainedStep]:
    """Train on one batch after another and yield each step, numbered from `steps_done` + 1.

    Raises TrainingDiverged at the first loss that is not a finite number.
    """
    for number, (images, target) in enumerate(batches, steps_done + 1):
        loss = float(trainer.train_step(images, target))
        if not math.isfinite(loss):
            raise TrainingDiverged(f"training diverged: the loss is {loss} at step {number}")
        yield TrainedStep(number, images, loss)


def evaluate_network(model: keras.Model, task: Task, batches: Batches) -> dict[str, Array]:
    """Return what `Trainer.evaluate` returns, for a network without an optimizer."""
    return evaluate_batches(tf.function(lambda images: model(images, training=False)), task, batches)


def evaluate_batches(
    predict: Callable[[tf.Tensor], tf.Tensor], task: Task, batches: Batches
) -> dict[str, Array]:
    """Return the task's arrays for the outputs of `predict` on all images, and "loss", their mean, [1]."""
    arrays: dict[str, list[Array]] = {}
    losses, sizes = [], []
    for images, target in batches:
        output = predict(images)
        losses.append(float(task.loss(output, target)))
        sizes.append(len(images))
        for name, values in task.sample_metrics(output.numpy(), np.asarray(target)).items():
            arrays.setdefault(name, []).append(values)
    joined = {name: np.concatenate(values) for name, values in arrays.items()}
    return joined | {"loss": np.array([np.average(losses, weights=sizes)])}
