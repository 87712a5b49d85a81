"""A network and how it learns: the compiled steps that every training loop of the project shares."""

from collections.abc import Callable, Iterable
from typing import Any

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.models import batch_norm
from laesi_tf.schedules import state
from laesi_tf.tasks import Task

# Batches (image uint8 [B, H, W, 3], target) as laesi_tf.data.synthetic.batches makes them.
Batches = Iterable[tuple[tf.Tensor, tf.Tensor]]
# From images to a model's output.
Infer = Callable[[tf.Tensor], tf.Tensor]


class Learner:
    """`model` with its optimizer: a training step, an inference and a recalibration, each traced once.

    What was traced serves any number of runs: `variables` are all that training changes, so setting them to
    what they were before it starts another.
    """

    def __init__(self, model: keras.Model, learned: Task, optimizer: keras.optimizers.Optimizer) -> None:
        self.model, self.task, self.optimizer = model, learned, optimizer
        optimizer.build(model.trainable_variables)
        # Before the step is traced: it sets the layers' momentum.
        self.recalibrate = batch_norm.make_recalibrator(model)
        self.infer = tf.function(lambda images: model(images, training=False))
        self.step: Callable[[tf.Tensor, tf.Tensor], tf.Tensor] = tf.function(self._step)

    @property
    def variables(self) -> list[Any]:
        """The model's variables, then the optimizer's, in an order that two equal learners share."""
        return [*self.model.variables, *state(self.optimizer)]

    def assess(self, batches: Batches) -> dict[str, np.ndarray]:
        """What the task says of every picture in `batches`, [N] per key; and "loss", their mean [1]."""
        return assessed(self.infer, self.task, batches)

    def _step(self, images: tf.Tensor, target: tf.Tensor) -> tf.Tensor:
        """Learn from one batch; the loss before it, a scalar."""
        with tf.GradientTape() as tape:
            loss = self.task.loss(self.model(images, training=True), target)
        variables = self.model.trainable_variables
        self.optimizer.apply(tape.gradient(loss, variables), variables)
        return loss


def assessed(
    infer: Callable[[tf.Tensor], tf.Tensor], judged: Task, batches: Batches
) -> dict[str, np.ndarray]:
    """What `judged` says of `infer`'s outputs for every picture in `batches`, as `Learner.assess` does."""
    found: dict[str, list[np.ndarray]] = {}
    losses, sizes = [], []
    for images, target in batches:
        output = infer(images)
        losses.append(float(judged.loss(output, target)))
        sizes.append(len(images))
        for key, values in judged.per_picture(output.numpy(), np.asarray(target)).items():
            found.setdefault(key, []).append(values)
    joined = {key: np.concatenate(values) for key, values in found.items()}
    return joined | {"loss": np.array([np.average(losses, weights=sizes)])}
