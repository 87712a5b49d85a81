"""Batch normalisation whose statistics are right at evaluation, however short the run.

Keras's MobileNetV3 averages them with momentum 0.999: after 2,000 steps from scratch the validation MRE was
72 % with that average and 12 % with statistics estimated afresh. So it is not used: statistics are
re-estimated before every evaluation ("precise" batch norm, Wu and Johnson 2021, section 3). Pretrained ones
may be frozen instead, which is less stable: from ImageNet, 250 steps of RMSprop on discs of
known area gave an MRE of 51 % frozen and 4.5 % recalibrated at a rate of 1e-3, 4.2 % and 4.4 % at 3e-4.
"""

from collections.abc import Callable, Iterable

import keras
import numpy as np
import tensorflow as tf

# The larger the batches, the nearer a pass in training mode is to one in inference mode, and the more memory
# it takes.
_CALIBRATION_BATCH_SIZE = 64


def batch_norm_layers(model: keras.Model) -> list[keras.layers.BatchNormalization]:
    """The batch-normalisation layers of `model` in its order."""
    return [layer for layer in model.layers if isinstance(layer, keras.layers.BatchNormalization)]


def freeze(model: keras.Model) -> None:
    """Keep the statistics, scale and offset of `model`'s layers as they are, in training as well."""
    for layer in batch_norm_layers(model):
        layer.trainable = False


def make_recalibrator(model: keras.Model) -> Callable[[Callable[[], Iterable[tf.Tensor]]], None]:
    """A function that sets the statistics of `model`'s unfrozen layers to those of pictures.

    It takes what gives image batches [B, H, W, 3] of equal size, and asks only if a layer is unfrozen. Mean
    and variance become exactly those over all pictures, every layer being fed what it is fed in training.
    Sets the layers' momentum to 0, so that a pass in training mode leaves its own batch's statistics: make
    the recalibrator before tracing a training step.
    """
    free = [layer for layer in batch_norm_layers(model) if layer.trainable]
    for layer in free:
        layer.momentum = 0.0
    forward = tf.function(lambda images: model(images, training=True))

    def recalibrate(pictures: Callable[[], Iterable[tf.Tensor]]) -> None:
        if not free:
            return
        moments = []
        for images in pictures():
            forward(images)
            moments.append([_moments(layer) for layer in free])
        for layer, *found in zip(free, *moments, strict=True):
            mean, square = np.mean(np.asarray(found), axis=0)
            layer.moving_mean.assign(mean)
            layer.moving_variance.assign(np.maximum(square - mean**2, 0.0))

    return recalibrate


def calibration_batches(batches: Iterable[tf.Tensor], pictures: int) -> list[tf.Tensor]:
    """The first `pictures` of image batches [B, H, W, 3], in the batches that a recalibrator is fed."""
    joined = tf.concat(list(batches), axis=0)[:pictures]
    return [
        joined[first : first + _CALIBRATION_BATCH_SIZE]
        for first in range(0, len(joined), _CALIBRATION_BATCH_SIZE)
    ]


def _moments(layer: keras.layers.BatchNormalization) -> tuple[np.ndarray, np.ndarray]:
    """First and second raw moment, [C] each, of the batch that `layer` saw last."""
    mean = layer.moving_mean.numpy().astype(np.float64)
    return mean, layer.moving_variance.numpy().astype(np.float64) + mean**2
