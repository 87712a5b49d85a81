"""Keras optimizers by name, driven by a learning-rate schedule."""

from collections.abc import Callable
from typing import Any

import keras

from laesi_tf.training.schedules import SCHEDULES, FunctionSchedule

# Keras's defaults where the paper is silent. A noisy scene can throw a gradient far off: its norm is clipped.
_CLIP = {"global_clipnorm": 1.0}
OPTIMIZERS: dict[str, Callable[..., keras.optimizers.Optimizer]] = {
    "rmsprop": lambda rate: keras.optimizers.RMSprop(rate, **_CLIP),
    "adam": lambda rate: keras.optimizers.Adam(rate, **_CLIP),
    "adamw": lambda rate: keras.optimizers.AdamW(rate, **_CLIP),
    "nadam": lambda rate: keras.optimizers.Nadam(rate, **_CLIP),
    "sgd": lambda rate: keras.optimizers.SGD(rate, momentum=0.9, nesterov=True, **_CLIP),
}


def make_optimizer(
    name: str, *, schedule: str, peak: float, final: float, steps: int
) -> keras.optimizers.Optimizer:
    """An optimizer of OPTIMIZERS whose rate follows a schedule of SCHEDULES over `steps` steps."""
    return OPTIMIZERS[name](FunctionSchedule(SCHEDULES[schedule], peak=peak, final=final, steps=steps))


def optimizer_variables(optimizer: keras.optimizers.Optimizer) -> list[Any]:
    """All variables of a built optimizer. Keras's Nadam has one that it does not list among its own."""
    unlisted = getattr(optimizer, "_u_product", None)
    return [*optimizer.variables, *([] if unlisted is None else [unlisted])]
