"""Leaf area from one image: MobileNetV3, global pooling, one number in a transformed unit.

The network learns the area's two factors beside it: how much of the picture is leaf, and how many pixels make
a millimetre. The area is their combination, so that what a scene teaches about either is not mixed up.
"""

import math
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
_FACTOR_WEIGHT = 0.5
_TYPICAL_VIEW_MM = 150.0


def build_area_network(base: keras.Model, *, transform: str) -> keras.Model:
    """Regression on `base`: [B, H, W, 3] of 0..255 -> [B, 3].

    Column 0 is the area in transformed units, 1 the logarithm of the scale in pixels per mm at the leaf, 2
    that of the leaf's share of the picture. The head is that of MobileNetV3's classifier (pool, hard-swish
    layer, linear layer) with fewer hidden units. It gives deviations relative to a typical leaf whatever the
    transform, so that the three transforms start alike and meet the same learning rate.
    """
    pooled = keras.layers.GlobalAveragePooling2D(name="pool")(base.output)
    hidden = keras.layers.Dense(_HIDDEN, activation="hard_swish", name="hidden")(pooled)
    scale = keras.layers.Dense(1, name="scale")(hidden)
    share = keras.layers.Dense(1, name="share")(hidden)
    # Tilt leaves the product of the two a little off: what is left is learned as well.
    rest = keras.layers.Dense(1, kernel_initializer="zeros", name="rest")(hidden)
    twice = keras.layers.Rescaling(-2.0, name="inverse_square")(scale)
    deviation = keras.layers.Add(name="deviation")([share, twice, rest])
    transformed = keras.layers.Rescaling(
        relative_error_unit(transform), offset=_typical_target(transform), name="transformed_area"
    )(deviation)
    typical_scale, typical_share = _typical_factors(base.input.shape[1:3])
    log_scale = keras.layers.Rescaling(1.0, offset=math.log(typical_scale), name="log_px_per_mm")(scale)
    log_share = keras.layers.Rescaling(1.0, offset=math.log(typical_share), name="log_share")(share)
    output = keras.layers.Concatenate(name="area_scale_share")([transformed, log_scale, log_share])
    return keras.Model(base.input, output, name="area")


def _typical_factors(size: tuple[int, int]) -> tuple[float, float]:
    """Scale, px per mm, of a view _TYPICAL_VIEW_MM wide, and the share that a typical leaf has of it."""
    scale = max(size) / _TYPICAL_VIEW_MM
    return scale, TYPICAL_AREA_CM2 * 100 * scale**2 / (size[0] * size[1])


def transform_area(area_cm2: tf.Tensor, transform: str) -> tf.Tensor:
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


def relative_error_unit(transform: str) -> float:
    """d target / d ln area at a typical leaf: what a relative error of 1 amounts to in transformed units."""
    return {"log": 1.0, "sqrt": 0.5 * TYPICAL_AREA_CM2**0.5, "none": TYPICAL_AREA_CM2}[transform]


def area_loss(output: tf.Tensor, target: tf.Tensor, *, transform: str, loss: str) -> tf.Tensor:
    """Mean loss, a scalar, of outputs [B, 3] against targets [B, 3]: area in cm2, px per mm, leaf's share.

    Errors are in relative units: with the log transform "l1" is the mean relative error to first order.
    "huber" is quadratic within 10 % and linear beyond: a few hopeless scenes do not rule the gradient. The
    factors count half as much as the area (the scale by its square, as in the area); unknown ones are NaN and
    do not count.
    """
    area_error = (output[:, 0] - transform_area(target[:, 0], transform)) / relative_error_unit(transform)
    known = tf.math.is_finite(target[:, 1:])
    factors = tf.math.log(tf.where(known, target[:, 1:], 1.0))
    factor_errors = tf.where(known, output[:, 1:] - factors, 0.0) * tf.constant([2.0, 1.0])
    of_factors = tf.reduce_sum(_elementwise_loss(factor_errors, loss), axis=1)
    return tf.reduce_mean(_elementwise_loss(area_error, loss) + _FACTOR_WEIGHT * of_factors)


def _elementwise_loss(error: tf.Tensor, loss: str) -> tf.Tensor:
    size = tf.abs(error)
    if loss == "l1":
        return size
    if loss == "mse":
        return tf.square(error)
    bent = tf.minimum(size, _HUBER_BEND)
    return bent * (size - 0.5 * bent) / _HUBER_BEND


def _typical_target(transform: str) -> float:
    return float(transform_area(tf.constant(TYPICAL_AREA_CM2), transform))
