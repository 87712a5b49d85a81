"""Counter-based random numbers: (seed, index, stream) names one sequence, whatever the order of sampling."""

import enum
from typing import Any

import tensorflow as tf


class Stream(enum.IntEnum):
    """What a sequence is sampled for.

    Each part of a scene and each prop has its own streams, so a part that changes leaves the others as they
    were. The values are part of every image: they are never reused.
    """

    # Parameters of the parts.
    LEAF_KIND = 0
    LEAF = 1
    SURFACE = 2
    PAPER = 3
    DESK = 4
    CAMERA = 5
    LIGHT = 6
    # Parameters and shape numbers of the props.
    HANDWRITING = 8
    HANDWRITING_SHAPE = 9
    FRAGMENT = 10
    FRAGMENT_SHAPE = 11
    LABEL = 12
    LABEL_SHAPE = 13
    COIN = 14
    COIN_SHAPE = 15
    PEN = 16
    PEN_SHAPE = 17
    CALIBRATION = 18
    CALIBRATION_SHAPE = 19
    PENCIL = 20
    PENCIL_SHAPE = 21
    RULER = 22
    RULER_SHAPE = 23
    CLIP = 24
    CLIP_SHAPE = 25
    NOTE = 26
    NOTE_SHAPE = 27
    BARCODE = 28
    BARCODE_SHAPE = 29
    FINGER = 30
    FINGER_SHAPE = 31
    # Numbers of shapes and noise fields.
    OUTLINE = 32
    BITES = 33
    HOLES = 34
    VEINS = 35
    SURFACE_BLEND = 36
    SURFACE_MOTTLE = 37
    SURFACE_SPOTS = 38
    SURFACE_UNDULATION = 39
    TEXTURE = 40
    PAPER_GRADIENT = 41
    PAPER_VORONOI = 42
    PAPER_SIMPLE = 43
    DESK_GRAIN = 44
    ILLUMINATION = 45
    SENSOR = 46
    # More props.
    TAPE = 48
    TAPE_SHAPE = 49
    SCRIBBLE = 50
    SCRIBBLE_SHAPE = 51
    PANE = 52
    PANE_SHAPE = 53
    # The part of a photo that the ruling network is trained on.
    CROP = 60


_PHILOX = tf.random.Algorithm.PHILOX.value
_MAX_STREAMS = 64
"""Streams per seed: a new stream leaves all others as they were."""


class RandomStreams:
    """The independent random streams of image (seed, index).

    Philox maps keys and counters to numbers that are independent whatever their pattern (Salmon et al. 2011):
    seed and stream are the key, the index is the upper half of the counter.
    """

    def __init__(self, seed: tf.Tensor | int, index: tf.Tensor | int) -> None:
        self._first_key = tf.cast(seed, tf.int64) * _MAX_STREAMS
        self._counter = tf.cast(tf.stack([0, tf.cast(index, tf.int64)]), tf.uint64)

    def uniform(self, shape: list[int], stream: Stream) -> tf.Tensor:
        """Return uniform float32 numbers of `shape` in [0, 1); longer vectors begin with the shorter ones."""
        return tf.raw_ops.StatelessRandomUniformV2(**self._generator_arguments(shape, stream))

    def normal(self, shape: list[int], stream: Stream) -> tf.Tensor:
        """Return standard normal float32 numbers of `shape`."""
        return tf.raw_ops.StatelessRandomNormalV2(**self._generator_arguments(shape, stream))

    def _generator_arguments(self, shape: list[int], stream: Stream) -> dict[str, Any]:
        """Return the arguments of the generator's raw ops; tf.random's functions take twenty ops more."""
        key = tf.cast(tf.stack([self._first_key + int(stream)]), tf.uint64)
        return {"shape": shape, "key": key, "counter": self._counter, "alg": _PHILOX}
