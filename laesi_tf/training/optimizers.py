"""Keras optimizers by name, driven by a learning-rate schedule."""

from collections.abc import Callable
from typing import Any

import keras

from laesi_tf.training.schedules import SCHEDULES, FunctionSchedule

# Keras's defaults, since the paper gives none. The norm of gradients is clipped: one noisy scene can make it
# huge.
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
    """Return an optimizer of OPTIMIZERS whose learning rate follows a schedule of SCHEDULES.

    `peak` and `final` are the highest and the last rate, `steps` the length of the run.
    """
    return OPTIMIZERS[name](FunctionSchedule(SCHEDULES[schedule], peak=peak, final=final, steps=steps))


def optimizer_variables(optimizer: keras.optimizers.Optimizer) -> list[Any]:
    """Return all variables of a built optimizer, with the one that Keras's Nadam does not list itself."""
    unlisted = getattr(inner_optimizer(optimizer), "_u_product", None)
    return [*optimizer.variables, *([] if unlisted is None else [unlisted])]


def inner_optimizer(optimizer: keras.optimizers.Optimizer) -> keras.optimizers.Optimizer:
    """Return the optimizer that a LossScaleOptimizer wraps; any other one is returned itself."""
    return getattr(optimizer, "inner_optimizer", optimizer)
