"""Counter-based random numbers: (seed, index, stream) names one sequence."""

import enum
from typing import Any

import tensorflow as tf


class Stream(enum.IntEnum):
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
_MAX_STREAMS = 64
"""Room for purposes to come: adding one leaves every other stream as it was."""


class RandomStreams:
    """The picture (seed, index): hands out independent streams by purpose.

    Philox is a bijection of (key, counter), so neighbouring keys are as independent as any other pair.
    """

    def __init__(self, seed: tf.Tensor | int, index: tf.Tensor | int) -> None:
        self.seed = tf.cast(seed, tf.int64)
        self.index = tf.cast(index, tf.int64)

    def _stream(self, shape: list[int], purpose: Stream) -> dict[str, Any]:
        """Arguments of the generator's bare ops: tf.random's functions wrap them in twenty more."""
        state = tf.stack([self.seed * _MAX_STREAMS + int(purpose), self.index])
        key, counter = tf.raw_ops.StatelessRandomGetKeyCounter(seed=state)
        return {"shape": shape, "key": key, "counter": counter, "alg": _PHILOX}

    def uniform(self, shape: list[int], purpose: Stream) -> tf.Tensor:
        """Uniform [0, 1) float32 numbers of `shape`."""
        return tf.raw_ops.StatelessRandomUniformV2(**self._stream(shape, purpose))

    def normal(self, shape: list[int], purpose: Stream) -> tf.Tensor:
        """Standard normal float32 numbers of `shape`."""
        return tf.raw_ops.StatelessRandomNormalV2(**self._stream(shape, purpose))
