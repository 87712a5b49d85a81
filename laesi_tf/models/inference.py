"""Run a Keras network on NumPy images."""

from collections.abc import Callable

import keras
import numpy as np
import tensorflow as tf

_BATCH_SIZE = 16
"""Pictures that go through a network together: more are not faster, and each takes memory."""


def compile_inference(model: keras.Model, size: tuple[int, int]) -> Callable[[np.ndarray], np.ndarray]:
    """Turn `model`, [B, h, w, 3] in 0..255 -> [B, ...], into uint8 [N, h, w, 3] -> float32 [N, ...]."""
    graph = tf.function(
        lambda batch: model(tf.cast(batch, tf.float32), training=False),
        input_signature=[tf.TensorSpec([None, *size, 3], tf.uint8)],
    )

    def predict(pictures: np.ndarray) -> np.ndarray:
        parts = [
            graph(pictures[first : first + _BATCH_SIZE]) for first in range(0, len(pictures), _BATCH_SIZE)
        ]
        return np.concatenate([part.numpy() for part in parts])

    return predict
