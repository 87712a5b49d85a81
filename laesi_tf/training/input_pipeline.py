"""Streams of training batches and the validation batches of a configuration."""

from collections.abc import Callable
from typing import cast

import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.data import augmentation, augmentation_ops, mixture, synthetic, tf_data_service
from laesi_tf.data.leaf_textures import load_textures
from laesi_tf.synthesis import load_ranges
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.trainer import Batches

# From the index of the first picture to an endless stream of batches.
BatchStream = Callable[[int], Batches]
_VALIDATION_SEED = 0


def make_training_stream(config: TrainConfig, data_service: str) -> BatchStream:
    """The stream that `config` names: live scenes or a mixture, augmented or not.

    Live scenes are made by the `data_service` at that address where there is one.
    """
    batch_size = config.batch_size
    if config.mixture and data_service:
        raise InputError("--data-service makes live scenes only; leave out --data-service or --mixture")
    textures = load_textures(config.textures) if config.textures else None
    sources = _open_mixture(config, textures)
    ranges = load_ranges(config.ranges)

    def live(places: tf.data.Dataset) -> tf.data.Dataset:
        # Runs of places are whole: a batch has so many leaves.
        passes = config.lighting_passes
        first = places.filter(lambda place: place % passes == 0)
        scenes = synthetic.samples_of_leaves(
            first.map(lambda place: (place + synthetic.TRAIN_INDICES[0]) // passes),
            seed=config.seed,
            size=config.size,
            ranges=ranges,
            passes=passes,
            textures=textures,
        )
        return _make_examples(
            scenes.map(lambda scene: (scene["index"] - synthetic.TRAIN_INDICES[0], scene)), config
        )

    def stream(start: int) -> Batches:
        if data_service:
            return tf_data_service.receive_batches(live, data_service, batch_size=batch_size, start=start)
        if sources:
            mixed = mixture.mix_sources(sources, seed=config.seed, start=start)
            examples = _make_examples(mixed.enumerate(start), config)
        else:
            examples = live(tf.data.Dataset.range(start, synthetic.TRAIN_INDICES[1]))
        return examples.map(lambda _, example: example).batch(batch_size).prefetch(2)

    return stream


def _make_examples(numbered: tf.data.Dataset, config: TrainConfig) -> tf.data.Dataset:
    """(place, (image, target)) of a stream of (place, picture), augmented as `config` says."""
    task_name = cast(synthetic.TaskName, config.task)
    switched = augmentation.augmentation_flags(augmentation.parse_augmentations(config.augment))

    def augmented(
        place: tf.Tensor, picture: augmentation_ops.Sample
    ) -> tuple[tf.Tensor, augmentation_ops.Sample]:
        return place, augmentation.augment_sample(
            picture, tf.stack([config.seed, place]), tf.constant(switched)
        )

    if switched.any():
        numbered = numbered.map(augmented, num_parallel_calls=tf.data.AUTOTUNE)
    return numbered.map(lambda place, picture: (place, synthetic.make_example(picture, task_name)))


def _open_mixture(config: TrainConfig, textures: tf.Tensor | None) -> list[mixture.Source]:
    if not config.mixture:
        return []
    if config.lighting_passes != 1:
        raise InputError("a mixture has one light for each leaf; leave out --lighting-passes or --mixture")
    return mixture.load_mixture(
        config.mixture,
        size=config.size,
        seed=config.seed,
        masked=config.task == "mask",
        ranges=config.ranges,
        textures=textures,
    )


def make_validation_batches(config: TrainConfig) -> Batches:
    # One seed for all runs: their scores compare. The range of indices keeps it apart from training.
    return synthetic.synthetic_batches(
        task=cast(synthetic.TaskName, config.task),
        batch_size=config.batch_size,
        seed=_VALIDATION_SEED,
        size=config.size,
        ranges=config.ranges,
        start=synthetic.VALIDATION_INDICES[0],
        count=config.validation_pictures,
        passes=1,
        textures=load_textures(config.textures) if config.textures else None,
    )
