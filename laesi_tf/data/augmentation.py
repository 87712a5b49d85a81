"""Select augmentations by name and apply them to samples inside tf.data."""

from collections.abc import Iterable

import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

from laesi_tf.common.errors import InputError
from laesi_tf.data.augmentation_ops import (
    Augmentation,
    add_gaussian_noise,
    add_poisson_noise,
    adjust_brightness,
    adjust_contrast,
    adjust_saturation,
    flip_left_right,
    rotate,
    rotate_quarter_turns,
    shift_hue,
)
from laesi_tf.data.sample import Sample

AUGMENTATIONS: dict[str, Augmentation] = {
    "brightness": adjust_brightness,
    "contrast": adjust_contrast,
    "hue": shift_hue,
    "saturation": adjust_saturation,
    "flip": flip_left_right,
    "rotation90": rotate_quarter_turns,
    "rotation": rotate,
    "gaussian": add_gaussian_noise,
    "poisson": add_poisson_noise,
}
"""In the order in which they are applied: light, then the camera's pose, then its sensor.

A function that is added here is known to `train --augment` once its name is also in `AUGMENTATION_NAMES` of
`laesi_tf.training.config`, which must not import TensorFlow; a test compares the two.
"""

PAPER_AUGMENTATIONS = ("brightness", "contrast", "hue", "saturation", "flip", "rotation90", "poisson")
"""The augmentations of the paper's best model."""


def parse_augmentations(text: str) -> tuple[str, ...]:
    """Return the names in `text`: "all", "paper", or augmentations separated by commas. Raises InputError."""
    if text in ("all", "paper"):
        return tuple(AUGMENTATIONS) if text == "all" else PAPER_AUGMENTATIONS
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    augmentation_flags(names)
    return names


def augmentation_flags(names: Iterable[str]) -> NDArray[np.bool_]:
    """Return bool [9], True for each of `names`, as `augment_sample` takes it.

    Raises InputError for an unknown name.
    """
    selected = list(names)
    for name in selected:
        if name not in AUGMENTATIONS:
            raise InputError(f"unknown augmentation {name!r}; choose from {', '.join(AUGMENTATIONS)}")
    return np.array([name in selected for name in AUGMENTATIONS])


def augment_sample(sample: Sample, seed: tf.Tensor, enabled: tf.Tensor) -> Sample:
    """Apply the augmentations that are `enabled`, bool [9] from `augmentation_flags`, to one sample.

    `image` is uint8 [H, W, 3], before and after; `seed` is int [2]. `enabled` may be a variable: it is read
    for every sample, so one traced pipeline serves any set of augmentations. A disabled one costs a branch.
    """
    seeds = tf.unstack(tf.random.split(seed, len(AUGMENTATIONS)))
    image = sample["image"]
    image.shape.assert_is_compatible_with([None, None, 3])
    sample = sample | {"image": tf.cast(image, tf.float32)}
    for position, apply in enumerate(AUGMENTATIONS.values()):
        sample = tf.cond(
            enabled[position],
            lambda sample=sample, apply=apply, seed=seeds[position]: apply(sample, seed),
            lambda sample=sample: dict(sample),
        )
    return sample | {"image": tf.cast(sample["image"] + 0.5, image.dtype)}
