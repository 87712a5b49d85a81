"""Training batches and validation batches of a configuration."""

import itertools
from collections.abc import Callable, Iterator

import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.common.network import check_reachable
from laesi_tf.data import synthetic, tf_data_service
from laesi_tf.data.augmentation import augment_sample, augmentation_flags, parse_augmentations
from laesi_tf.data.batch_part import WHOLE_BATCH, BatchPart
from laesi_tf.data.copy_paste import paste_leaves
from laesi_tf.data.leaf_textures import load_textures
from laesi_tf.data.mixture import Source, load_mixture, mix_sources
from laesi_tf.data.sample import Sample
from laesi_tf.synthesis import load_ranges
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.device_synthesis import (
    AUTO,
    CPU,
    find_synthesis_device,
    render_batches,
    render_on_replicas,
)
from laesi_tf.training.replicas import ONE_DEVICE, Replicas
from laesi_tf.training.tasks import TASKS, make_task
from laesi_tf.training.trainer import Batches

Example = tuple[tf.Tensor, tf.Tensor]
"""An image and its target, or a batch of each."""
_VALIDATION_SEED = 0
"""The same for all runs, so that their scores compare; its range of indices separates it from training."""


class InputPipeline:
    """What a run is fed: live scenes or a mixture, augmented or not, and fresh scenes to validate on.

    Everything that `config` names is opened at once. Raises InputError for files that cannot be used and for
    a data service that does not answer.
    """

    def __init__(
        self,
        config: TrainConfig,
        *,
        data_service: str = "",
        synthesis_device: str = AUTO,
        replicas: Replicas = ONE_DEVICE,
    ) -> None:
        self._config, self._data_service, self._replicas = config, data_service, replicas
        if replicas.strategy is not None and synthesis_device not in (AUTO, CPU):
            raise InputError(
                f"with --strategy {replicas.name} each device renders its own part; leave out --strategy or "
                f"--synthesis-device {synthesis_device}"
            )
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
        if config.copy_paste and replicas.strategy is not None:
            self._device = None  # leaves are pasted from one half of the batch onto the other
        if data_service:
            check_reachable(data_service)
        self._ranges = make_task(config).choose_ranges(load_ranges(config.ranges))
        self._textures = load_textures(config.textures) if config.textures else None
        self._sources = self._open_mixture()

    def training_batches(self, start: int) -> Batches:
        """Return the endless stream of batches whose first sample has the index `start`.

        Each batch is the part that this process makes, on each of its devices where these render.
        """
        if self._device is not None:
            return self._render_on_device(self._device, start)
        return self._make_batches(start, self._replicas.part)

    def whole_batches(self, start: int) -> Batches:
        """Return the same stream without parts: what a single process trains on."""
        if self._replicas.strategy is None:
            return self.training_batches(start)
        return self._make_batches(start, WHOLE_BATCH)

    def _make_batches(self, start: int, part: BatchPart) -> Batches:
        config = self._config
        if self._data_service:
            return tf_data_service.receive_batches(
                self._live_examples, self._data_service, batch_size=config.batch_size, start=start, part=part
            )
        if self._sources:
            mixed = mix_sources(self._sources, seed=config.seed, start=start).enumerate(start)
            # Where a source is in its own stream depends on all samples before: each process makes them all.
            examples = self._make_examples(part.select(mixed, config.batch_size))
            return _report_data_loss(self._batch(examples, part), config.mixture)
        indices = part.select(tf.data.Dataset.range(start, synthetic.TRAIN_INDICES[1]), config.batch_size)
        return self._batch(self._live_examples(indices), part)

    def _render_on_device(self, device: str, start: int) -> Batches:
        config, strategy = self._config, self._replicas.strategy
        renderer = make_task(config).renderer()
        scene = {"size": config.size, "ranges": self._ranges.with_passes(1), "textures": self._textures}

        def render(index: tf.Tensor) -> Sample:
            return renderer(config.seed, index=index + synthetic.TRAIN_INDICES[0], **scene)

        options = {"batch_size": config.batch_size, "start": start}
        if strategy is not None:
            return render_on_replicas(strategy, render, self._example_maker(), **options)
        batches = render_batches(device, render, self._example_maker(), **options)
        if not config.copy_paste:
            return batches
        firsts = itertools.count(start, config.batch_size)
        numbered = zip(firsts, batches, strict=False)
        return (
            self._paste_leaves(tf.constant([first], tf.int64), examples)[1] for first, examples in numbered
        )

    def _batch(self, numbered: tf.data.Dataset, part: BatchPart) -> tf.data.Dataset:
        """Return batches of (image, target) from the `numbered` (index, example) of a part."""
        batches = numbered.batch(part.size(self._config.batch_size))
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
