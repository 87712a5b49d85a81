"""Leaf area from one image: MobileNetV3, global pooling, one number in a transformed unit."""

from typing import Any

import keras
import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

TRANSFORMS = ("log", "sqrt", "none")
LOSSES = ("huber", "l1", "mse")
# About the median of the synthetic leaves: where the output starts, so that the first steps are not spent
# on moving it there.
TYPICAL_AREA_CM2 = 25.0
# Areas outside are no leaf; the bounds keep exp() of an untrained network's output finite.
SMALLEST_CM2, LARGEST_CM2 = 1e-3, 1e5
_HIDDEN = 256
_HUBER_BEND = 0.1


def area_model(base: keras.Model, *, transform: str) -> keras.Model:
    """Regression on `base`: [B, H, W, 3] of 0..255 -> [B, 1], the area in transformed units.

    The head is that of MobileNetV3's classifier (pool, hard-swish layer, linear layer) with fewer hidden
    units. The last learned number is a relative deviation from a typical leaf whatever the transform, so that
    the three transforms start alike and meet the same learning rate.
    """
    pooled = keras.layers.GlobalAveragePooling2D(name="pool")(base.output)
    hidden = keras.layers.Dense(_HIDDEN, activation="hard_swish", name="hidden")(pooled)
    deviation = keras.layers.Dense(1, name="deviation")(hidden)
    output = keras.layers.Rescaling(
        relative_unit(transform), offset=_typical(transform), name="transformed_area"
    )(deviation)
    return keras.Model(base.input, output, name="area")


def to_target(area_cm2: tf.Tensor, transform: str) -> tf.Tensor:
    """Transform areas in cm2, any shape: log makes errors relative, sqrt is in a note of the paper."""
    if transform == "log":
        return tf.math.log(area_cm2)
    return tf.sqrt(area_cm2) if transform == "sqrt" else area_cm2


def to_area_cm2(output: Any, transform: str) -> NDArray[np.float64]:
    """Invert `to_target` for a network's output of any shape; the result is in cm2, positive and finite.

    NaN stays NaN.
    """
    values = np.asarray(output, np.float64)
    if transform == "log":
        values = np.exp(np.clip(values, np.log(SMALLEST_CM2), np.log(LARGEST_CM2)))
    elif transform == "sqrt":
        values = np.square(np.maximum(values, 0.0))
    return np.clip(values, SMALLEST_CM2, LARGEST_CM2)


def relative_unit(transform: str) -> float:
    """d target / d ln area at a typical leaf: what a relative error of 1 amounts to in transformed units."""
    return {"log": 1.0, "sqrt": 0.5 * TYPICAL_AREA_CM2**0.5, "none": TYPICAL_AREA_CM2}[transform]


def area_loss(output: tf.Tensor, area_cm2: tf.Tensor, *, transform: str, loss: str) -> tf.Tensor:
    """Mean loss, a scalar, of outputs [B, 1] against areas in cm2 [B].

    Errors are in relative units: with the log transform "l1" is the mean relative error to first order.
    "huber" is quadratic within 10 % and linear beyond: a few hopeless scenes do not rule the gradient.
    """
    error = (output[:, 0] - to_target(area_cm2, transform)) / relative_unit(transform)
    if loss == "l1":
        return tf.reduce_mean(tf.abs(error))
    if loss == "mse":
        return tf.reduce_mean(tf.square(error))
    size = tf.abs(error)
    bent = tf.minimum(size, _HUBER_BEND)
    return tf.reduce_mean(bent * (size - 0.5 * bent)) / _HUBER_BEND


def _typical(transform: str) -> float:
    return float(to_target(tf.constant(TYPICAL_AREA_CM2), transform))
