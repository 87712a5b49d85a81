"""Training batches and validation batches of a configuration."""

import itertools
from collections.abc import Callable, Iterator

import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.common.network import check_reachable
from laesi_tf.data import synthetic, tf_data_service
from laesi_tf.data.augmentation import augment_sample, augmentation_flags, parse_augmentations
from laesi_tf.data.copy_paste import paste_leaves
from laesi_tf.data.leaf_textures import load_textures
from laesi_tf.data.mixture import Source, load_mixture, mix_sources
from laesi_tf.data.sample import Sample
from laesi_tf.synthesis import load_ranges
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.device_synthesis import AUTO, CPU, find_synthesis_device, render_batches
from laesi_tf.training.tasks import TASKS, make_task
from laesi_tf.training.trainer import Batches

Example = tuple[tf.Tensor, tf.Tensor]
"""An image and its target, or a batch of each."""
BatchStream = Callable[[int], Batches]
"""From the index of the first sample to an endless stream of batches."""
_VALIDATION_SEED = 0
"""The same for all runs, so that their scores compare; its range of indices separates it from training."""


class InputPipeline:
    """What a run is fed: live scenes or a mixture, augmented or not, and fresh scenes to validate on.

    Everything that `config` names is opened at once. Raises InputError for files that cannot be used and for
    a data service that does not answer.
    """

    def __init__(self, config: TrainConfig, *, data_service: str = "", synthesis_device: str = AUTO) -> None:
        self._config, self._data_service = config, data_service
        self._device = find_synthesis_device(synthesis_device)
        if config.mixture and data_service:
            raise InputError("--data-service makes live scenes only; leave out --data-service or --mixture")
        if config.copy_paste and data_service:
            raise InputError("--data-service pastes no leaves; leave out --data-service or --copy-paste")
        if config.mixture or config.lighting_passes != 1 or data_service:
            if synthesis_device not in (AUTO, CPU):
                raise InputError(
                    "--synthesis-device renders live scenes with one light for each leaf; leave it out, or "
                    "--mixture, --lighting-passes and --data-service"
                )
            self._device = None
        if data_service:
            check_reachable(data_service)
        self._ranges = make_task(config).choose_ranges(load_ranges(config.ranges))
        self._textures = load_textures(config.textures) if config.textures else None
        self._sources = self._open_mixture()

    def training_batches(self, start: int) -> Batches:
        """Return the endless stream of batches whose first sample has the index `start`."""
        config = self._config
        if self._device is not None:
            return self._render_on_device(self._device, start)
        if self._data_service:
            return tf_data_service.receive_batches(
                self._live_examples, self._data_service, batch_size=config.batch_size, start=start
            )
        if self._sources:
            mixed = mix_sources(self._sources, seed=config.seed, start=start)
            return _report_data_loss(self._batch(self._make_examples(mixed.enumerate(start))), config.mixture)
        return self._batch(self._live_examples(tf.data.Dataset.range(start, synthetic.TRAIN_INDICES[1])))

    def _render_on_device(self, device: str, start: int) -> Batches:
        config, render = self._config, make_task(self._config).renderer()
        scene = {"size": config.size, "ranges": self._ranges.with_passes(1), "textures": self._textures}
        batches = render_batches(
            device,
            lambda index: render(config.seed, index=index + synthetic.TRAIN_INDICES[0], **scene),
            self._example_maker(),
            batch_size=config.batch_size,
            start=start,
        )
        if not config.copy_paste:
            return batches
        firsts = itertools.count(start, config.batch_size)
        numbered = zip(firsts, batches, strict=False)
        return (
            self._paste_leaves(tf.constant([first], tf.int64), examples)[1] for first, examples in numbered
        )

    def _batch(self, numbered: tf.data.Dataset) -> tf.data.Dataset:
        """Return batches of (image, target) from `numbered` (index, example)."""
        batches = numbered.batch(self._config.batch_size)
        if self._config.copy_paste:
            batches = batches.map(self._paste_leaves, num_parallel_calls=tf.data.AUTOTUNE)
        return batches.map(lambda _, examples: examples).prefetch(2)

    def _paste_leaves(self, indices: tf.Tensor, examples: Example) -> tuple[tf.Tensor, Example]:
        seed = tf.stack([tf.cast(self._config.seed, indices.dtype), indices[0]])
        return indices, paste_leaves(*examples, seed=seed, share=self._config.copy_paste)

    def validation_batches(self) -> Batches:
        """Return batches of fresh scenes, the same ones for all runs of a task, size and ranges."""
        config, task = self._config, make_task(self._config)
        samples = synthetic.synthetic_samples(
            seed=_VALIDATION_SEED,
            size=config.size,
            ranges=self._ranges,
            start=synthetic.VALIDATION_INDICES[0],
            count=config.validation_pictures,
            passes=1,
            textures=self._textures,
            render=task.renderer(),
        )
        examples = samples.map(lambda sample: (sample["image"], task.make_target(sample)))
        return examples.batch(config.batch_size).prefetch(2)

    def _live_examples(self, indices: tf.data.Dataset) -> tf.data.Dataset:
        """Return (index, (image, target)) for `indices`, which hold all lighting passes of a leaf or none."""
        passes = self._config.lighting_passes
        first_passes = indices.filter(lambda index: index % passes == 0)
        samples = synthetic.samples_of_leaves(
            first_passes.map(lambda index: (index + synthetic.TRAIN_INDICES[0]) // passes),
            seed=self._config.seed,
            size=self._config.size,
            ranges=self._ranges,
            passes=passes,
            textures=self._textures,
            render=make_task(self._config).renderer(),
        )
        return self._make_examples(
            samples.map(lambda sample: (sample["index"] - synthetic.TRAIN_INDICES[0], sample))
        )

    def _make_examples(self, numbered: tf.data.Dataset) -> tf.data.Dataset:
        """Return (index, (image, target)) from (index, sample), augmented as the configuration says."""
        make_example = self._example_maker()
        return numbered.map(
            lambda index, sample: (index, make_example(index, sample)), num_parallel_calls=tf.data.AUTOTUNE
        )

    def _example_maker(self) -> Callable[[tf.Tensor, Sample], Example]:
        """Return the function from (index, sample) to (image, target)."""
        task, seed = make_task(self._config), self._config.seed
        enabled = augmentation_flags(parse_augmentations(self._config.augment))

        def make_example(index: tf.Tensor, sample: Sample) -> Example:
            if enabled.any():
                sample = augment_sample(sample, tf.stack([seed, index]), tf.constant(enabled))
            return sample["image"], task.make_target(sample)

        return make_example

    def _open_mixture(self) -> list[Source]:
        config = self._config
        if not config.mixture:
            return []
        if config.lighting_passes != 1:
            raise InputError(
                "a mixture has one light for each leaf; leave out --lighting-passes or --mixture"
            )
        return load_mixture(
            config.mixture,
            size=config.size,
            seed=config.seed,
            needs_masks=TASKS[config.task].needs_masks,
            needs_leaf=TASKS[config.task].needs_leaf,
            ranges=config.ranges,
            textures=self._textures,
        )


def _report_data_loss(batches: Batches, mixture: str) -> Iterator[tuple[tf.Tensor, tf.Tensor]]:
    """Yield `batches`; raise InputError where the bytes of a shard do not match their checksums."""
    try:
        yield from batches
    except tf.errors.DataLossError as error:
        raise InputError(
            f"a data set of {mixture} is damaged ({error.message}); run generate again, which checks every "
            "shard and replaces damaged ones"
        ) from error
