"""The network that says, for each cell of 16 x 16 pixels, whether a ruling can be read there, how fine and
which way.

Plain convolutions in bottlenecks: a ruling is texture, and depthwise convolutions mix too little of it per
layer. The input is the photo and, beside it, the photo with its local mean and contrast evened, so that faint
print counts as much as bold.
"""

import math
from typing import NamedTuple

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.models.ruling_cells import (
    CELL_PX,
    DIRECTION_BINS,
    FINEST_PX,
    LOG_STEP,
    PERIOD_BINS,
    CellAnswers,
)

HEADS = {
    "readable": 1,
    "finest_uncertain": 1,
    "periods": PERIOD_BINS,
    "heaviest": PERIOD_BINS,
    "directions": DIRECTION_BINS,
}
"""Output channels in order: a ruling of two crossing families can be read; finer lines are printed than can
be seen; period of the finest visible lines; period of the heaviest visible lines; direction modulo 90
degrees."""
CHANNELS = sum(HEADS.values())
NOT_ASKED = -1
"""In `readable` and `finest_uncertain`: the cell does not count."""
_FAINTEST = 0.015
"""Added to the local contrast, on the scale -1..1, so that noise on even paper is not blown up."""
_WEIGHTS = {"readable": 1.0, "finest_uncertain": 0.5, "periods": 1.0, "heaviest": 0.5, "directions": 0.5}
"""Of the heads' losses in the sum."""


class RulingTargets(NamedTuple):
    """What is printed in the cells [B, h, w] of a batch of crops."""

    readable: tf.Tensor
    """1, 0 or NOT_ASKED."""
    finest_uncertain: tf.Tensor
    """1 where finer lines are printed than can be seen, 0 where the finest are seen, or NOT_ASKED."""
    log_period: tf.Tensor
    """ln of pixels per period of the finest visible lines, geometric mean of both families."""
    log_heaviest: tf.Tensor
    """ln of pixels per period of the heaviest visible lines; of the finest where none are heavier."""
    direction: tf.Tensor
    """0..1, in units of 90 degrees."""


def build_ruling_network(height: int | None = None, width: int | None = None) -> keras.Model:
    """Build the ruling network, of 0.47 M weights.

    It maps [B, height, width, 3] RGB of 0..255, sides multiples of 16, to logits [B, h, w, CHANNELS].
    """
    picture = keras.Input((height, width, 3), name="picture")
    x = _even_contrast(picture)
    x = _convolve(x, 48, 8, stride=4, name="stem")
    x = _convolve(x, 96, 3, stride=2, name="to_eighth")
    for index in range(2):
        x = _bottleneck(x, name=f"eighth_{index}")
    x = _convolve(x, 144, 3, stride=2, name="to_sixteenth")
    for index, dilation in enumerate((1, 2, 1)):
        x = _bottleneck(x, dilation=dilation, name=f"sixteenth_{index}")
    return keras.Model(picture, keras.layers.Conv2D(CHANNELS, 1, name="heads")(x), name="ruling")


def _even_contrast(picture: keras.KerasTensor) -> keras.KerasTensor:
    """Return six channels: `picture` on -1..1, and its local deviation over the local contrast.

    The deviation is from the local mean.
    """
    scaled = keras.layers.Rescaling(1 / 127.5, -1, name="to_unit")(picture)
    rest = keras.ops.subtract(scaled, _average_locally(scaled))
    power = keras.ops.mean(keras.ops.square(rest), axis=-1, keepdims=True)
    contrast = keras.ops.sqrt(_average_locally(power) + _FAINTEST**2)
    return keras.layers.Concatenate(name="with_evened")([scaled, keras.ops.divide(rest, contrast)])


def _average_locally(values: keras.KerasTensor) -> keras.KerasTensor:
    return EnlargeCells()(keras.layers.AveragePooling2D(CELL_PX, padding="same")(values))


class EnlargeCells(keras.layers.Layer):
    """Interpolates cells to their pixels, bilinearly, as `tf.image.resize`.

    As a convolution whose channels become pixels: it holds for images of any size, while LiteRT's resizing
    needs a fixed one, and 40 bytes per pixel.
    """

    def call(self, cells: tf.Tensor) -> tf.Tensor:
        """Return [B, CELL_PX * h, CELL_PX * w, C] for `cells` [B, h, w, C]."""
        channels = cells.shape[-1]
        offsets = (np.arange(CELL_PX, dtype=np.float32) + 0.5) / CELL_PX - 0.5
        # Shares [3, CELL_PX] of the cell before, the cell itself and the one after.
        shares = np.stack([np.maximum(-offsets, 0), 1 - np.abs(offsets), np.maximum(offsets, 0)])
        kernel = np.einsum("yp,xq,cd->yxcpqd", shares, shares, np.eye(channels, dtype=np.float32))
        kernel = kernel.reshape(3, 3, channels, CELL_PX * CELL_PX * channels)
        # Beyond the border, the outermost cells repeat.
        around = tf.pad(cells, [[0, 0], [1, 1], [1, 1], [0, 0]], "SYMMETRIC")
        return tf.nn.depth_to_space(tf.nn.conv2d(around, kernel, 1, "VALID"), CELL_PX)

    def compute_output_shape(self, input_shape: tuple[int | None, ...]) -> tuple[int | None, ...]:
        """Return the shape of the pixels; None where it is unknown."""
        batch, *sides, channels = input_shape
        return batch, *(None if side is None else CELL_PX * side for side in sides), channels


def _convolve(
    x: keras.KerasTensor,
    channels: int,
    size: int,
    *,
    name: str,
    stride: int = 1,
    dilation: int = 1,
    relu: bool = True,
) -> keras.KerasTensor:
    x = keras.layers.Conv2D(
        channels, size, strides=stride, dilation_rate=dilation, padding="same", use_bias=False, name=name
    )(x)
    x = keras.layers.BatchNormalization(momentum=0.9, epsilon=1e-3, name=f"{name}_bn")(x)
    return keras.layers.ReLU(name=f"{name}_relu")(x) if relu else x


def _bottleneck(x: keras.KerasTensor, *, name: str, dilation: int = 1) -> keras.KerasTensor:
    channels = x.shape[-1]
    y = _convolve(x, channels // 2, 1, name=f"{name}_in")
    y = _convolve(y, channels // 2, 3, dilation=dilation, name=f"{name}_mid")
    y = _convolve(y, channels, 1, relu=False, name=f"{name}_out")
    return keras.layers.ReLU(name=f"{name}_relu")(keras.layers.Add(name=f"{name}_add")([x, y]))


def split_heads(logits: tf.Tensor) -> dict[str, tf.Tensor]:
    """Return the channels of `logits` [..., CHANNELS] by head; single channels without their axis."""
    parts = dict(zip(HEADS, tf.split(logits, list(HEADS.values()), -1), strict=True))
    return {name: part[..., 0] if HEADS[name] == 1 else part for name, part in parts.items()}


def to_answers(logits: tf.Tensor) -> CellAnswers:
    """Return probabilities for the cells of one level from `logits` [h, w, CHANNELS]."""
    heads = split_heads(logits)
    return CellAnswers(
        readable=tf.sigmoid(heads["readable"]),
        finest_uncertain=tf.sigmoid(heads["finest_uncertain"]),
        periods=tf.nn.softmax(heads["periods"]),
        directions=tf.nn.softmax(heads["directions"]),
    )


def ruling_losses(logits: tf.Tensor, targets: RulingTargets) -> dict[str, tf.Tensor]:
    """Return the mean cross entropy of each head, scalars, of `logits` [B, h, w, CHANNELS].

    Periods and directions are asked where a ruling can be read; a value between two bins is shared by both.
    """
    heads = split_heads(logits)
    readable = tf.cast(targets.readable == 1, tf.float32)
    expected = {
        "periods": share_between_bins(to_bin(targets.log_period), PERIOD_BINS, circular=False),
        "heaviest": share_between_bins(to_bin(targets.log_heaviest), PERIOD_BINS, circular=False),
        "directions": share_between_bins(targets.direction * DIRECTION_BINS, DIRECTION_BINS, circular=True),
    }
    losses = {
        name: _mean_over(tf.nn.softmax_cross_entropy_with_logits(expected[name], heads[name]), readable)
        for name in expected
    }
    for name, flags in (("readable", targets.readable), ("finest_uncertain", targets.finest_uncertain)):
        truth, asked = tf.cast(flags == 1, tf.float32), tf.cast(flags != NOT_ASKED, tf.float32)
        crossed = tf.nn.sigmoid_cross_entropy_with_logits(labels=truth, logits=heads[name])
        losses[name] = _mean_over(crossed, asked)
    return losses


def ruling_loss(logits: tf.Tensor, targets: RulingTargets) -> tf.Tensor:
    """Return the weighted sum of the heads' losses, a scalar."""
    losses = ruling_losses(logits, targets)
    return tf.add_n([_WEIGHTS[name] * value for name, value in losses.items()])


def to_bin(log_period: tf.Tensor) -> tf.Tensor:
    """Return fractional bins of ln of pixels per period."""
    return (log_period - math.log(FINEST_PX)) / LOG_STEP


def share_between_bins(place: tf.Tensor, count: int, *, circular: bool) -> tf.Tensor:
    """Return weights [..., count] on the two bins nearest to fractional `place` [...], which sum to 1."""
    if not circular:
        place = tf.clip_by_value(place, 0.0, count - 1.001)
    low = tf.floor(place)
    share = (place - low)[..., None]
    first = tf.cast(low, tf.int32)
    return (1 - share) * tf.one_hot(first % count, count) + share * tf.one_hot((first + 1) % count, count)


def _mean_over(values: tf.Tensor, weights: tf.Tensor) -> tf.Tensor:
    return tf.reduce_sum(values * weights) / (tf.reduce_sum(weights) + 1)
