"""A network with its optimizer, and the compiled steps that train and evaluate it."""

from collections.abc import Callable, Iterable
from typing import Any

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.models import batch_norm
from laesi_tf.models.backbone import FROM_SCRATCH, build_backbone
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.optimizers import optimizer_variables
from laesi_tf.training.tasks import make_task
from laesi_tf.training.tasks.base import Task

# Batches (image uint8 [B, H, W, 3], target) as laesi_tf.data.synthetic.batches makes them.
Batches = Iterable[tuple[tf.Tensor, tf.Tensor]]
# From images to a model's output.
Infer = Callable[[tf.Tensor], tf.Tensor]


class Trainer:
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
        return [*self.model.variables, *optimizer_variables(self.optimizer)]

    def assess(self, batches: Batches) -> dict[str, np.ndarray]:
        """What the task says of every picture in `batches`, [N] per key; and "loss", their mean [1]."""
        return evaluate_batches(self.infer, self.task, batches)

    def _step(self, images: tf.Tensor, target: tf.Tensor) -> tf.Tensor:
        """Learn from one batch; the loss before it, a scalar."""
        with tf.GradientTape() as tape:
            loss = self.task.loss(self.model(images, training=True), target)
        variables = self.model.trainable_variables
        self.optimizer.apply(tape.gradient(loss, variables), variables)
        return loss


def evaluate_batches(
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


class TrainingDiverged(InputError):
    """The loss stopped being a number: the configuration asks too much of the optimizer."""


def initialise_network(config: TrainConfig, *, origin: str | None = None) -> tuple[keras.Model, str]:
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
    return make_task(config).build(base), origin


def evaluate_network(model: keras.Model, judged: Task, batches: Batches) -> dict[str, np.ndarray]:
    """What `judged` says of every picture in `batches`, [N] per key; and "loss", their mean [1]."""
    return evaluate_batches(tf.function(lambda images: model(images, training=False)), judged, batches)
