"""A Keras model as a function of one picture."""

from collections.abc import Callable

import keras
import numpy as np
import tensorflow as tf


def compiled(model: keras.Model, size: tuple[int, int]) -> Callable[[np.ndarray], np.ndarray]:
    """Turn `model`, [B, h, w, 3] in 0..255 -> [B, ...], into uint8 [h, w, 3] -> float32 [...]."""
    graph = tf.function(
        lambda batch: model(tf.cast(batch, tf.float32), training=False),
        input_signature=[tf.TensorSpec([1, *size, 3], tf.uint8)],
    )
    return lambda image: graph(image[np.newaxis]).numpy()[0]
