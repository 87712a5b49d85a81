"""Counter-based random numbers: (seed, index, stream) names one sequence, whatever the order of drawing."""

import enum
from typing import Any

import tensorflow as tf


class Stream(enum.IntEnum):
    """What a sequence is drawn for. The numbers are part of every image, so they are never reused."""

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
"""Streams per seed: a new stream leaves all others as they were."""


class RandomStreams:
    """The independent random streams of image (seed, index).

    Philox is a bijection of (key, counter), so neighbouring seeds are as independent as any other pair.
    """

    def __init__(self, seed: tf.Tensor | int, index: tf.Tensor | int) -> None:
        self._seed = tf.cast(seed, tf.int64)
        self._index = tf.cast(index, tf.int64)

    def uniform(self, shape: list[int], stream: Stream) -> tf.Tensor:
        """Return uniform float32 numbers of `shape` in [0, 1)."""
        return tf.raw_ops.StatelessRandomUniformV2(**self._generator_arguments(shape, stream))

    def normal(self, shape: list[int], stream: Stream) -> tf.Tensor:
        """Return standard normal float32 numbers of `shape`."""
        return tf.raw_ops.StatelessRandomNormalV2(**self._generator_arguments(shape, stream))

    def _generator_arguments(self, shape: list[int], stream: Stream) -> dict[str, Any]:
        """Return the arguments of the generator's raw ops; tf.random's functions wrap them in twenty more
        ops."""
        state = tf.stack([self._seed * _MAX_STREAMS + int(stream), self._index])
        key, counter = tf.raw_ops.StatelessRandomGetKeyCounter(seed=state)
        return {"shape": shape, "key": key, "counter": counter, "alg": _PHILOX}
