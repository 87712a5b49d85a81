"""Regress the leaf area from one image: MobileNetV3, global pooling, one number in a transformed unit.

The network also predicts the two factors of the area: the fraction of the image that is leaf, and the scale
in pixels per millimetre. The area is their combination, so that each factor gets its own error signal.
"""

import math
from typing import Any

import keras
import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

TRANSFORMS = ("log", "sqrt", "none")
LOSSES = ("huber", "l1", "mse")
# About the median of the synthetic leaves: the output starts there, so that no training steps are spent on
# it.
TYPICAL_AREA_CM2 = 25.0
# No leaf is outside of these bounds, which keep exp() of an untrained network's output finite.
SMALLEST_CM2, LARGEST_CM2 = 1e-3, 1e5
_HIDDEN = 256
_HUBER_DELTA = 0.1
_FACTOR_WEIGHT = 0.5
_TYPICAL_VIEW_MM = 150.0


def build_area_network(base: keras.Model, *, transform: str) -> keras.Model:
    """Add the regression head to `base`: [B, H, W, 3] of 0..255 -> [B, 3].

    Column 0 is the area in transformed units, 1 the logarithm of the scale in pixels per mm at the leaf, 2
    that of the leaf's fraction of the image. The head is that of MobileNetV3's classifier (pooling,
    hard-swish layer, linear layer) with fewer hidden units. Its outputs are deviations relative to a typical
    leaf, so that all transforms start at the same area and need the same learning rate.
    """
    pooled = keras.layers.GlobalAveragePooling2D(name="pool")(base.output)
    hidden = keras.layers.Dense(_HIDDEN, activation="hard_swish", name="hidden")(pooled)
    scale = keras.layers.Dense(1, name="scale")(hidden)
    share = keras.layers.Dense(1, name="share")(hidden)
    # With tilt, the product of the two factors is not quite the area; this output learns the difference.
    rest = keras.layers.Dense(1, kernel_initializer="zeros", name="rest")(hidden)
    inverse_square = keras.layers.Rescaling(-2.0, name="inverse_square")(scale)
    deviation = keras.layers.Add(name="deviation")([share, inverse_square, rest])
    transformed = keras.layers.Rescaling(
        relative_error_unit(transform), offset=_typical_target(transform), name="transformed_area"
    )(deviation)
    typical_scale, typical_share = _typical_factors(base.input.shape[1:3])
    log_scale = keras.layers.Rescaling(1.0, offset=math.log(typical_scale), name="log_px_per_mm")(scale)
    log_share = keras.layers.Rescaling(1.0, offset=math.log(typical_share), name="log_share")(share)
    output = keras.layers.Concatenate(name="area_scale_share")([transformed, log_scale, log_share])
    return keras.Model(base.input, output, name="area")


def _typical_factors(size: tuple[int, int]) -> tuple[float, float]:
    """Return the scale in px/mm of a view 150 mm wide, and the fraction of it that a typical leaf covers."""
    scale = max(size) / _TYPICAL_VIEW_MM
    return scale, TYPICAL_AREA_CM2 * 100 * scale**2 / (size[0] * size[1])


def transform_area(area_cm2: tf.Tensor, transform: str) -> tf.Tensor:
    """Transform areas in cm2, of any shape: log makes errors relative, sqrt is in a note of the paper."""
    if transform == "log":
        return tf.math.log(area_cm2)
    return tf.sqrt(area_cm2) if transform == "sqrt" else area_cm2


def to_area_cm2(output: Any, transform: str) -> NDArray[np.float64]:
    """Invert `transform_area` for outputs of any shape: cm2, positive and finite; NaN stays NaN."""
    values = np.asarray(output, np.float64)
    if transform == "log":
        values = np.exp(np.clip(values, np.log(SMALLEST_CM2), np.log(LARGEST_CM2)))
    elif transform == "sqrt":
        values = np.square(np.maximum(values, 0.0))
    return np.clip(values, SMALLEST_CM2, LARGEST_CM2)


def relative_error_unit(transform: str) -> float:
    """Return d target / d ln(area) at a typical leaf: a relative error of 1 in transformed units."""
    return {"log": 1.0, "sqrt": 0.5 * TYPICAL_AREA_CM2**0.5, "none": TYPICAL_AREA_CM2}[transform]


def area_loss(output: tf.Tensor, target: tf.Tensor, *, transform: str, loss: str) -> tf.Tensor:
    """Return the mean loss, a scalar, of outputs [B, 3] for targets [B, 3]: cm2, px/mm, leaf fraction.

    Errors are in relative units: with the log transform, "l1" is the mean relative error to first order.
    "huber" is quadratic within 10 % and linear beyond, so that a few impossible scenes do not dominate the
    gradient. The factors have half the weight of the area (the scale enters squared, as in the area); unknown
    ones are NaN and have none.
    """
    area_error = (output[:, 0] - transform_area(target[:, 0], transform)) / relative_error_unit(transform)
    is_known = tf.math.is_finite(target[:, 1:])
    factors = tf.math.log(tf.where(is_known, target[:, 1:], 1.0))
    factor_errors = tf.where(is_known, output[:, 1:] - factors, 0.0) * tf.constant([2.0, 1.0])
    factor_loss = tf.reduce_sum(_elementwise_loss(factor_errors, loss), axis=1)
    return tf.reduce_mean(_elementwise_loss(area_error, loss) + _FACTOR_WEIGHT * factor_loss)


def _elementwise_loss(error: tf.Tensor, loss: str) -> tf.Tensor:
    magnitude = tf.abs(error)
    if loss == "l1":
        return magnitude
    if loss == "mse":
        return tf.square(error)
    quadratic = tf.minimum(magnitude, _HUBER_DELTA)
    return quadratic * (magnitude - 0.5 * quadratic) / _HUBER_DELTA


def _typical_target(transform: str) -> float:
    return float(transform_area(tf.constant(TYPICAL_AREA_CM2), transform))
