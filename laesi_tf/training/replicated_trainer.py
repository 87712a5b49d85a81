"""A trainer whose steps run on several devices and equal those of one device with the same batch."""

from collections.abc import Callable, Iterable

import keras
import tensorflow as tf

from laesi_tf.models import batch_norm
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.initialisation import initialise_network
from laesi_tf.training.optimizers import inner_optimizer, make_optimizer
from laesi_tf.training.replicas import Replicas
from laesi_tf.training.tasks import make_task
from laesi_tf.training.tasks.base import Array, Task
from laesi_tf.training.trainer import Batches, Trainer


def make_trainer(
    config: TrainConfig, replicas: Replicas, *, origin: str | None = None
) -> tuple[Trainer, str]:
    """Return a trainer of a new network on `replicas`, and the origin of the network's weights.

    See `initialise_network` for `origin`.
    """
    model, found = initialise_network(config, origin=origin)
    if replicas.strategy is not None:
        weights = model.get_weights()
        # Loading weights can build further networks, and every process must create the same variables: so the
        # network on all devices is built anew and then filled.
        with replicas.scope():
            model, _ = initialise_network(config, origin=found)
            model.set_weights(weights)
    with replicas.scope():
        optimizer = make_optimizer(
            config.optimizer,
            schedule=config.schedule,
            peak=config.learning_rate,
            final=config.final_learning_rate,
            steps=config.steps,
        )
        if config.precision == "mixed_float16":
            # Small gradients are 0 in float16, unlike in bfloat16.
            optimizer = keras.optimizers.LossScaleOptimizer(optimizer)
    if replicas.strategy is None:
        return Trainer(model, make_task(config), optimizer), found
    return ReplicatedTrainer(model, make_task(config), optimizer, replicas), found


class ReplicatedTrainer(Trainer):
    """A network whose variables are kept equal on all devices of `replicas`.

    Batch normalisation uses the statistics of the whole batch. The gradient is the mean over all replicas,
    and its norm is clipped after that. Recalibration and validation run on the first device of this process.
    """

    def __init__(
        self, model: keras.Model, task: Task, optimizer: keras.optimizers.Optimizer, replicas: Replicas
    ) -> None:
        """Take a `model` and an `optimizer` that were created in the scope of `replicas`."""
        self._replicas = replicas
        for layer in batch_norm.batch_norm_layers(model):
            layer.synchronized = True
        # Keras clips the gradient of each replica and then sums them. What `apply` is given here is already
        # the mean over all replicas, which must be clipped and not be summed again.
        inner = inner_optimizer(optimizer)
        inner._all_reduce_sum_gradients = lambda gradients_and_variables: gradients_and_variables
        with replicas.scope():
            super().__init__(model, task, optimizer)
        self._recalibrate = self.recalibrate
        self.recalibrate = self._recalibrate_in_scope
        self._distributed_step = tf.function(self._run_replicas)
        self.train_step = self._train_part

    def evaluate(self, batches: Batches) -> dict[str, Array]:
        """Return what `Trainer.evaluate` returns."""
        with self._replicas.scope():
            return super().evaluate(batches)

    def _recalibrate_in_scope(self, make_batches: Callable[[], Iterable[tf.Tensor]]) -> None:
        with self._replicas.scope():
            self._recalibrate(make_batches)

    def _train_part(self, images: tf.Tensor, target: tf.Tensor) -> tf.Tensor:
        """Update the network on a batch, of which this process has a part; return the loss of all of it."""
        with self._replicas.report_lost_workers():
            return self._distributed_step(self._replicas.split(images), self._replicas.split(target))

    def _run_replicas(self, images: tf.Tensor, target: tf.Tensor) -> tf.Tensor:
        strategy = self._replicas.strategy
        losses = strategy.run(self._train_step, args=(images, target))
        return strategy.reduce(tf.distribute.ReduceOp.MEAN, losses, axis=None)

    def _loss(self, output: tf.Tensor, target: tf.Tensor) -> tf.Tensor:
        if self.task.loss_is_mean_over_images:
            return self.task.loss(output, target)
        # Every replica gets the same loss, that of all outputs, and the gradient of its own part in all n of
        # them: the mean over replicas is again the gradient of one device.
        return self.task.loss(_gather(output), _gather(target))

    def _reduce(self, gradients: list[tf.Tensor]) -> list[tf.Tensor]:
        return tf.distribute.get_replica_context().all_reduce(tf.distribute.ReduceOp.MEAN, gradients)


def _gather(part: tf.Tensor) -> tf.Tensor:
    """Return the parts [B, ...] of all replicas, joined; call it in one of these."""
    # Gathering needs to know a device, which an argument of the step has not, and forgets the shape.
    context = tf.distribute.get_replica_context()
    return tf.ensure_shape(context.all_gather(tf.identity(part), axis=0), [None, *part.shape[1:]])
