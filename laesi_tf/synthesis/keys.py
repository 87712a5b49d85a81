"""Keys of the counter-based generator: (seed, index, purpose) names one stream of random numbers."""

import enum
from typing import Any

import tensorflow as tf


class Purpose(enum.IntEnum):
    """What a stream is drawn for; the numbers are part of every picture, so they are never reused."""

    SCENE = 0
    LIGHT = 1
    OUTLINE = 2
    BITES = 3
    HOLES = 4
    VEINS = 5
    PAPER = 6
    PAPER_VORONOI = 7
    SURFACE = 8
    SURFACE_VORONOI = 9
    SPOTS = 10
    PROPS = 11
    ILLUMINATION = 13
    DESK = 14
    SENSOR = 15
    TEXTURE = 16
    PAPER_GRADIENT = 17
    MOTTLE = 18


_PHILOX = tf.random.Algorithm.PHILOX.value
_PURPOSES = 64
"""Room for purposes to come: adding one leaves every other stream as it was."""


class Key:
    """The picture (seed, index): hands out independent streams by purpose.

    Philox is a bijection of (key, counter), so neighbouring keys are as independent as any other pair.
    """

    def __init__(self, seed: tf.Tensor | int, index: tf.Tensor | int) -> None:
        self.seed = tf.cast(seed, tf.int64)
        self.index = tf.cast(index, tf.int64)

    def _stream(self, shape: list[int], purpose: Purpose) -> dict[str, Any]:
        """Arguments of the generator's bare ops: tf.random's functions wrap them in twenty more."""
        state = tf.stack([self.seed * _PURPOSES + int(purpose), self.index])
        key, counter = tf.raw_ops.StatelessRandomGetKeyCounter(seed=state)
        return {"shape": shape, "key": key, "counter": counter, "alg": _PHILOX}

    def uniform(self, shape: list[int], purpose: Purpose) -> tf.Tensor:
        """Uniform [0, 1) float32 numbers of `shape`."""
        return tf.raw_ops.StatelessRandomUniformV2(**self._stream(shape, purpose))

    def normal(self, shape: list[int], purpose: Purpose) -> tf.Tensor:
        """Standard normal float32 numbers of `shape`."""
        return tf.raw_ops.StatelessRandomNormalV2(**self._stream(shape, purpose))
