"""Batch normalisation whose statistics are right at evaluation, however short the training.

Keras's MobileNetV3 averages them with momentum 0.999: after 2,000 steps from random weights the validation
MRE was 72 % with that average and 12 % with statistics computed afresh. So the average is not used:
statistics are recomputed before every evaluation ("precise" batch norm, Wu and Johnson 2021, section 3).
Pretrained ones may be frozen instead, which is less stable: from ImageNet weights, 250 steps of RMSprop on
discs of known area gave an MRE of 51 % frozen and 4.5 % recalibrated at a learning rate of 1e-3, 4.2 % and
4.4 % at 3e-4.
"""

from collections.abc import Callable, Iterable
from typing import Any

import keras
import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

# Larger batches bring a forward pass in training mode closer to one in inference mode, and need more memory.
_CALIBRATION_BATCH_SIZE = 64


def batch_norm_layers(model: keras.Model) -> list[keras.layers.BatchNormalization]:
    """Return the batch-normalisation layers of `model` in its order."""
    return [layer for layer in model.layers if isinstance(layer, keras.layers.BatchNormalization)]


def freeze(model: keras.Model) -> None:
    """Keep the statistics, scale and offset of all batch-normalisation layers, also in training."""
    for layer in batch_norm_layers(model):
        layer.trainable = False


def make_recalibrator(model: keras.Model) -> Callable[[Callable[[], Iterable[tf.Tensor]]], None]:
    """Return a function that sets the statistics of `model`'s unfrozen layers to those of given images.

    The function takes a callable that returns image batches [B, H, W, 3] of equal size, which it calls only
    if a layer is unfrozen. Mean and variance become exactly those over all images, while every layer gets the
    inputs that it gets in training. Sets the layers' momentum to 0, so that a pass in training mode stores
    the statistics of its own batch: make the recalibrator before a training step is traced.
    """
    unfrozen = [layer for layer in batch_norm_layers(model) if layer.trainable]
    for layer in unfrozen:
        layer.momentum = 0.0
    forward = tf.function(lambda images: model(images, training=True))

    def recalibrate(make_batches: Callable[[], Iterable[tf.Tensor]]) -> None:
        if not unfrozen:
            return
        moments = []
        for images in make_batches():
            forward(images)
            moments.append([_moments(layer) for layer in unfrozen])
        for layer, *layer_moments in zip(unfrozen, *moments, strict=True):
            mean, square = np.mean(np.asarray(layer_moments), axis=0)
            layer.moving_mean.assign(mean)
            layer.moving_variance.assign(np.maximum(square - mean**2, 0.0))

    return recalibrate


def calibration_batches(batches: Iterable[tf.Tensor], count: int) -> list[tf.Tensor]:
    """Join image batches [B, H, W, 3] and return their first `count` images in batches of 64."""
    joined = tf.concat(list(batches), axis=0)[:count]
    return [
        joined[first : first + _CALIBRATION_BATCH_SIZE]
        for first in range(0, len(joined), _CALIBRATION_BATCH_SIZE)
    ]


def _moments(layer: keras.layers.BatchNormalization) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the first and second raw moment, [C] each, of the last batch that `layer` saw."""
    mean = layer.moving_mean.numpy().astype(np.float64)
    return mean, layer.moving_variance.numpy().astype(np.float64) + mean**2
