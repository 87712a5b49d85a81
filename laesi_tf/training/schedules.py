"""Learning-rate schedules.

A schedule is a function (step, *, peak, final, steps) -> rate in plain TensorFlow: `step` counts from 0 to
`steps` - 1, `peak` is the highest rate and `final` the last one. Scalar in, float32 scalar out.
"""

import math
from collections.abc import Callable
from typing import Any

import keras
import tensorflow as tf

from laesi_tf.training.config import TrainConfig

Schedule = Callable[..., tf.Tensor]

# Fractions of the run at which piecewise decay drops. The paper gives only the ends, 1e-3 and 1e-9: seven
# plateaus make the factor ten. Rates below 1e-6 change the weights by less than rounding, so those plateaus
# get 3 % of the steps together, and the two highest get 80 %.
_DROPS = (0.5, 0.8, 0.94, 0.97, 0.98, 0.99)
_WARM_UP = 0.05


def constant_schedule(step: tf.Tensor, *, peak: float, final: float, steps: int) -> tf.Tensor:
    """Return `peak` at every step."""
    return tf.fill(tf.shape(step), tf.constant(peak, tf.float32))


def piecewise_decay(step: tf.Tensor, *, peak: float, final: float, steps: int) -> tf.Tensor:
    """Fall in seven plateaus of equal ratio from `peak` to `final`: the paper's piecewise constant decay."""
    passed = sum(tf.cast(_fraction_done(step, steps) >= drop, tf.float32) for drop in _DROPS)
    return _interpolate_geometrically(peak, final, passed / len(_DROPS))


def exponential_decay(step: tf.Tensor, *, peak: float, final: float, steps: int) -> tf.Tensor:
    """Fall by the same ratio every step, from `peak` to `final`."""
    return _interpolate_geometrically(peak, final, _fraction_done(step, steps))


def linear_decay(step: tf.Tensor, *, peak: float, final: float, steps: int) -> tf.Tensor:
    """Fall by the same amount every step, from `peak` to `final`."""
    progress = _fraction_done(step, steps)
    return (1.0 - progress) * peak + progress * final


def cosine_decay(step: tf.Tensor, *, peak: float, final: float, steps: int) -> tf.Tensor:
    """Rise linearly over the first 5 % of the run, then fall along half a cosine to `final`."""
    progress = _fraction_done(step, steps)
    rising = peak * (tf.cast(step, tf.float32) + 1.0) / max(1.0, math.ceil(_WARM_UP * steps))
    fallen = tf.maximum(progress - _WARM_UP, 0.0) / (1.0 - _WARM_UP)
    falling = final + (peak - final) * 0.5 * (1.0 + tf.cos(math.pi * fallen))
    return tf.where(progress < _WARM_UP, tf.minimum(rising, peak), falling)


SCHEDULES: dict[str, Schedule] = {
    "piecewise": piecewise_decay,
    "cosine": cosine_decay,
    "exponential": exponential_decay,
    "linear": linear_decay,
    "constant": constant_schedule,
}


def learning_rate_at(step: int, config: TrainConfig) -> float:
    """Return the learning rate of a run at `step`, counted from 0."""
    rate = SCHEDULES[config.schedule](
        tf.constant(step),
        peak=config.learning_rate,
        final=config.final_learning_rate,
        steps=config.steps,
    )
    return float(rate)


class TableSchedule(keras.optimizers.schedules.LearningRateSchedule):
    """A schedule in a table, float32 [steps], that can be replaced while a graph is in use.

    One compiled training step thus serves every schedule: call `set_schedule` before each run.
    """

    def __init__(self, steps: int) -> None:
        super().__init__()
        self.steps = steps
        self.table = tf.Variable(tf.zeros([steps]), trainable=False, name="rates")

    def set_schedule(self, schedule: str, *, peak: float, final: float, steps: int | None = None) -> None:
        """Set the table to a schedule of SCHEDULES over `steps`, or its whole length."""
        rates = SCHEDULES[schedule](tf.range(self.steps), peak=peak, final=final, steps=steps or self.steps)
        self.table.assign(rates)

    def __call__(self, step: Any) -> tf.Tensor:
        return tf.gather(self.table, tf.minimum(tf.cast(step, tf.int32), self.steps - 1))


class FunctionSchedule(keras.optimizers.schedules.LearningRateSchedule):
    """A schedule for Keras from a plain function."""

    def __init__(self, schedule: Schedule, **ends: Any) -> None:
        super().__init__()
        self.schedule, self.ends = schedule, ends

    def __call__(self, step: Any) -> tf.Tensor:
        return self.schedule(tf.convert_to_tensor(step), **self.ends)


def _fraction_done(step: tf.Tensor, steps: int) -> tf.Tensor:
    return tf.clip_by_value(tf.cast(step, tf.float32) / max(1, steps - 1), 0.0, 1.0)


def _interpolate_geometrically(peak: float, final: float, progress: tf.Tensor) -> tf.Tensor:
    """Go from `peak` to `final` in equal ratios as `progress` goes from 0 to 1."""
    return peak * tf.exp(math.log(final / peak) * progress)
