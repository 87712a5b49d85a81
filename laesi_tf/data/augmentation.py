"""Select augmentations by name and apply them to samples inside tf.data."""

from collections.abc import Iterable

import numpy as np
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.data.augmentation_ops import (
    Augmentation,
    Sample,
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
"""In the order in which they are applied: light, then the camera's pose, then its sensor."""

PAPER_AUGMENTATIONS = ("brightness", "contrast", "hue", "saturation", "flip", "rotation90", "poisson")
"""Those of the paper's best model."""


def parse_augmentations(text: str) -> tuple[str, ...]:
    """What `text` names: "all", "paper", or augmentations separated by commas. Raises InputError."""
    if text in ("all", "paper"):
        return tuple(AUGMENTATIONS) if text == "all" else PAPER_AUGMENTATIONS
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    augmentation_flags(names)
    return names


def augmentation_flags(names: Iterable[str]) -> np.ndarray:
    """bool [9], True for each of `names`, as `augment` takes them. Raises InputError for an unknown name."""
    wanted = list(names)
    for name in wanted:
        if name not in AUGMENTATIONS:
            raise InputError(f"unknown augmentation {name!r}; choose from {', '.join(AUGMENTATIONS)}")
    return np.array([name in wanted for name in AUGMENTATIONS])


def augment_sample(picture: Sample, seed: tf.Tensor, enabled: tf.Tensor) -> Sample:
    """Apply the augmentations that are `enabled`, bool [9] as `switches` gives it, to one picture.

    `image` is uint8 [H, W, 3] here, in and out. `enabled` may be a variable: which augmentations run is
    decided for every picture anew, so that one traced pipeline serves any set of them; one that is off costs
    a branch.
    """
    seeds = tf.unstack(tf.random.split(seed, len(AUGMENTATIONS)))
    image = picture["image"]
    picture = picture | {"image": tf.cast(image, tf.float32)}
    for row, change in enumerate(AUGMENTATIONS.values()):
        picture = tf.cond(
            enabled[row],
            lambda picture=picture, change=change, seed=seeds[row]: change(picture, seed),
            lambda picture=picture: dict(picture),
        )
    return picture | {"image": tf.cast(picture["image"] + 0.5, image.dtype)}
