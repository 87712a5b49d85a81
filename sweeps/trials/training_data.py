"""The images of a study: rendered once per worker, kept in memory, augmented anew for every trial.

Fresh scenes would cost more than the training at this size. The images are the same for every worker and
trial, as each is a function of its index; a trial's seed decides their order and their augmentation.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import tensorflow as tf

from laesi_tf.common.metrics import mre
from laesi_tf.common.progress import progress_bar
from laesi_tf.data import augmentation, synthetic
from laesi_tf.synthesis import load_ranges
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import make_task
from sweeps.trials.budget import EVALUATION_BATCH, Budget

_SCENES_SEED = 0
Batch = tuple[tf.Tensor, tf.Tensor]


class TrainingData:
    """Training batches (image uint8 [B, S, S, 3], target float32 [B, 3]) and a validation set of the same."""

    validation: list[Batch]

    def __init__(
        self,
        budget: Budget,
        *,
        threads: int,
        make_samples: Callable[[Budget, Sequence[int]], Batch] | None = None,
    ) -> None:
        """Render the images; `make_samples(budget, indices)` replaces the synthetic scenes.

        With `budget.silhouette_steps` an image has a fourth channel, 255 on the leaf.
        """
        count = budget.pictures
        first = synthetic.TRAIN_INDICES[0], synthetic.VALIDATION_INDICES[0]
        indices = [*range(first[0], first[0] + count), *range(first[1], first[1] + budget.validation)]
        images, targets = (make_samples or render_scenes)(budget, indices)
        self._images, self._targets = images[:count], targets[:count]
        self.validation = [
            (images[start : start + EVALUATION_BATCH, ..., :3], targets[start : start + EVALUATION_BATCH])
            for start in range(count, count + budget.validation, EVALUATION_BATCH)
        ]
        # Variables, so that one pipeline, traced once, serves every trial.
        self._augmentations = tf.Variable(augmentation.augmentation_flags(()))
        self._seed = tf.Variable(0, dtype=tf.int64)
        self._batches = self._make_pipeline(budget, threads)

    def iterate_batches(self, augmentations: tuple[str, ...], seed: int) -> Iterator[Batch]:
        """Iterate over the batches of a trial, one per step, or more; one trial at a time."""
        self._augmentations.assign(augmentation.augmentation_flags(augmentations))
        self._seed.assign(seed)
        return iter(self._batches)

    def constant_guess_mre(self) -> float:
        """Return the lowest MRE, in percent, that one constant area gives on all validation images.

        The best constant is the median of the areas with weights 1 / area, as an error counts relative to the
        true area.
        """
        areas = np.sort(np.concatenate([target[:, 0] for _, target in self.validation]))
        weights = np.cumsum(1.0 / areas)
        guess = areas[np.searchsorted(weights, weights[-1] / 2)]
        return mre(np.full_like(areas, guess), areas)

    def _make_pipeline(self, budget: Budget, threads: int) -> tf.data.Dataset:
        options = tf.data.Options()
        # One thread besides those that train; more would only compete with them.
        options.threading.private_threadpool_size = 1
        options.autotune.enabled = False
        # Optimising the pipeline takes longer than it saves in a trial of seconds.
        options.experimental_optimization.apply_default_optimizations = False
        self._silhouettes = budget.silhouette_steps * budget.batch_size
        positions = tf.data.Dataset.range(max(budget.steps, budget.warm_start_steps) * budget.batch_size)
        batches = positions.map(self._sample_at, num_parallel_calls=threads).batch(budget.batch_size)
        return batches.prefetch(2).with_options(options)

    def _sample_at(self, position: tf.Tensor) -> Batch:
        """Return the sample at `position` of a trial's stream: epochs, each in an order of its own."""
        count = len(self._images)
        seed = tf.stack([self._seed, position // count])
        index = tf.random.experimental.index_shuffle(position % count, seed, count - 1)
        image = self._images[index]
        if self._silhouettes:
            silhouette = tf.repeat(image[..., 3:], 3, axis=-1)
            image = tf.where(position < self._silhouettes, silhouette, image[..., :3])
        sample = augmentation.augment_sample(
            {"image": image},
            tf.stack([self._seed, position]),
            tf.convert_to_tensor(self._augmentations),
        )
        return sample["image"], self._targets[index]


def render_scenes(budget: Budget, indices: Sequence[int]) -> Batch:
    """Render the scenes of these indices: images uint8 [N, S, S, 3 or 4], targets float32 [N, 3]."""
    task = make_task(TrainConfig(task="area"))
    samples = synthetic.samples_of_leaves(
        tf.data.Dataset.from_tensor_slices(np.asarray(indices, np.int64)),
        seed=_SCENES_SEED,
        size=(budget.size, budget.size),
        ranges=task.choose_ranges(load_ranges(budget.ranges)),
        passes=1,
    )
    if budget.silhouette_steps:
        samples = samples.map(_add_silhouette)
    batches = synthetic.batch_samples(samples, make_target=task.make_target, batch_size=EVALUATION_BATCH)
    count = -(-len(indices) // EVALUATION_BATCH)
    images, targets = zip(*progress_bar(batches, total=count, desc="images", unit="batch"), strict=True)
    return tf.concat(images, axis=0), tf.concat(targets, axis=0)


def _add_silhouette(sample: dict[str, tf.Tensor]) -> dict[str, tf.Tensor]:
    """Add the mask to the image, as a fourth channel of 0 and 255."""
    return sample | {"image": tf.concat([sample["image"], 255 * sample["mask"][..., None]], axis=-1)}
