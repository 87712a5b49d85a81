"""Run a Keras network on NumPy images."""

from collections.abc import Callable
from typing import Any

import keras
import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

_BATCH_SIZE = 16
"""Larger batches are not faster and need more memory."""


def compile_inference(
    model: keras.Model, size: tuple[int, int]
) -> Callable[[NDArray[np.uint8]], NDArray[Any]]:
    """Compile `model`, [B, h, w, 3] in 0..255 -> [B, ...], for images of `size` (h, w).

    Returns a function from uint8 [N, h, w, 3] to float32 [N, ...].
    """
    graph = tf.function(
        lambda batch: model(tf.cast(batch, tf.float32), training=False),
        input_signature=[tf.TensorSpec([None, *size, 3], tf.uint8)],
    )

    def predict(images: NDArray[np.uint8]) -> NDArray[Any]:
        batches = [images[first : first + _BATCH_SIZE] for first in range(0, len(images), _BATCH_SIZE)]
        return np.concatenate([graph(batch).numpy() for batch in batches])

    return predict


def freeze_network(network: keras.Model) -> Callable[..., tf.Tensor]:
    """Return `network` as a function of images with its weights as constants, for a graph to be exported.

    The converter to LiteRT drops the variables of a Keras model in silence.
    """
    trainable = [variable.numpy() for variable in network.trainable_variables]
    others = [variable.numpy() for variable in network.non_trainable_variables]

    def infer(images: tf.Tensor, *, training: bool = False) -> tf.Tensor:
        del training
        weights = [[tf.constant(value) for value in values] for values in (trainable, others)]
        return network.stateless_call(*weights, images, training=False)[0]

    return infer
