"""The pictures of a study: made once per worker, kept in memory, augmented anew for every trial.

Live scenes would cost more than the training at this size. They are the same for every worker and trial,
being a function of their index; a trial's seed decides their order and what augmentation does to each.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import tensorflow as tf

from laesi_tf.common.metrics import mre
from laesi_tf.common.progress import progress_bar
from laesi_tf.data import augmentation, synthetic
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import make_task
from sweeps.trials.budget import EVALUATION_BATCH, Budget

_SCENES_SEED = 0
Batch = tuple[tf.Tensor, tf.Tensor]


class TrainingData:
    """Training batches (image uint8 [B, S, S, 3], target float32 [B, 3]) and a validation set of the same."""

    validation: list[Batch]

    def __init__(
        self, budget: Budget, *, threads: int, made: Callable[[Budget, Sequence[int]], Batch] | None = None
    ) -> None:
        """Make them; `made(budget, indices)` replaces the synthetic scenes of these indices."""
        count = budget.pictures
        judged = range(synthetic.VALIDATION_INDICES[0], synthetic.VALIDATION_INDICES[0] + budget.validation)
        learned = range(synthetic.TRAIN_INDICES[0], synthetic.TRAIN_INDICES[0] + count)
        every, targets = (made or render_scenes)(budget, [*learned, *judged])
        self._images, self._targets = every[:count], targets[:count]
        images, targets = every[count:], targets[count:]
        firsts = range(0, budget.validation, EVALUATION_BATCH)
        self.validation = [
            (images[first : first + EVALUATION_BATCH], targets[first : first + EVALUATION_BATCH])
            for first in firsts
        ]
        # Variables, so that the pipeline is traced once and serves every trial.
        self._switches = tf.Variable(augmentation.augmentation_flags(()))
        self._seed = tf.Variable(0, dtype=tf.int64)
        self._batches = self._pipeline(budget, threads)

    def training(self, augmentations: tuple[str, ...], seed: int) -> Iterator[Batch]:
        """The batches of a trial, one per step. Begin no other trial before this one is done with them."""
        self._switches.assign(augmentation.augmentation_flags(augmentations))
        self._seed.assign(seed)
        return iter(self._batches)

    def guess_mre(self) -> float:
        """The lowest MRE, in percent, of one guess for all validation pictures: what learning must beat.

        The guess is the median of the areas when each weighs as much as its error counts, one over itself.
        """
        areas = np.sort(np.concatenate([target[:, 0] for _, target in self.validation]))
        weights = np.cumsum(1.0 / areas)
        guess = areas[np.searchsorted(weights, weights[-1] / 2)]
        return mre(np.full_like(areas, guess), areas)

    def _pipeline(self, budget: Budget, threads: int) -> tf.data.Dataset:
        options = tf.data.Options()
        # One thread besides those that train: more would only take turns with them.
        options.threading.private_threadpool_size = 1
        options.autotune.enabled = False
        # Rewriting the pipeline takes longer than it gains in a trial of seconds.
        options.experimental_optimization.apply_default_optimizations = False
        places = tf.data.Dataset.range(budget.steps * budget.batch_size)
        batches = places.map(self._at, num_parallel_calls=threads).batch(budget.batch_size)
        return batches.prefetch(2).with_options(options)

    def _at(self, place: tf.Tensor) -> Batch:
        """The picture at `place` of a trial's stream: all pictures in one order, then all in another."""
        count = len(self._images)
        seed = tf.stack([self._seed, place // count])
        index = tf.random.experimental.index_shuffle(place % count, seed, count - 1)
        picture = augmentation.augment_sample(
            {"image": self._images[index]},
            tf.stack([self._seed, place]),
            tf.convert_to_tensor(self._switches),
        )
        return picture["image"], self._targets[index]


def render_scenes(budget: Budget, indices: Sequence[int]) -> Batch:
    """The scenes of these indices: images uint8 [N, S, S, 3], targets float32 [N, 3]."""
    pictures = synthetic.samples_of_leaves(
        tf.data.Dataset.from_tensor_slices(np.asarray(indices, np.int64)),
        seed=_SCENES_SEED,
        size=(budget.size, budget.size),
        passes=1,
    )
    make_target = make_task(TrainConfig(task="area")).make_target
    batches = synthetic.batch_samples(pictures, make_target=make_target, batch_size=EVALUATION_BATCH)
    count = -(-len(indices) // EVALUATION_BATCH)
    images, targets = zip(*progress_bar(batches, total=count, desc="pictures", unit="batch"), strict=True)
    return tf.concat(images, axis=0), tf.concat(targets, axis=0)
