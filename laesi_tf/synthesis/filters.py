"""Blurs: a Gaussian by its taps, and a wide Gaussian with a shift, computed at a quarter of the resolution."""

import math

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.xla import compile_with_xla


@compile_with_xla
def gaussian_blur(image: tf.Tensor, sigma: tf.Tensor, reach: int) -> tf.Tensor:
    """Gaussian blur of [..., H, W] by `sigma` pixels, with 2 * `reach` + 1 taps on each axis."""
    taps = tf.exp(-0.5 * (tf.range(reach + 1, dtype=tf.float32) / tf.maximum(sigma, 1e-3)) ** 2)
    taps = tf.unstack(taps / (2 * tf.reduce_sum(taps) - 1))
    return _convolve(_convolve(image, taps, axis=-1), taps, axis=-2)


def _convolve(image: tf.Tensor, taps: list[tf.Tensor], axis: int) -> tf.Tensor:
    reach = len(taps) - 1
    length = image.shape[axis]
    first, last = (tf.repeat(tf.gather(image, [end], axis=axis), reach, axis=axis) for end in (0, length - 1))
    # Repeating the border by hand: tf.pad's mirror modes cost more than the convolution.
    padded = tf.concat([first, image, last], axis=axis)

    def shifted(offset: int) -> tf.Tensor:
        window = [slice(None)] * image.shape.rank
        window[axis] = slice(reach + offset, reach + offset + length)
        return padded[tuple(window)]

    result = shifted(0) * taps[0]
    for offset in range(1, reach + 1):
        result += (shifted(offset) + shifted(-offset)) * taps[offset]
    return result


_BLOCK_PX = 4
"""Pixels a side of the blocks on which shadows are made."""


def blur_and_shift(
    coverage: tf.Tensor,
    size: ImageSize,
    spread_px: tf.Tensor,
    *,
    shift: tf.Tensor | tuple[float, float] = (0.0, 0.0),
) -> noise.SeparableField:
    """Blur a field [H, W] that ends in zeros by a Gaussian of `spread_px` and shift it by (x, y) pixels."""
    coarse = _block_means(coverage, size)
    down = _gaussian_resampling_matrix(size[0], shift[1], spread_px)
    across = _gaussian_resampling_matrix(size[1], shift[0], spread_px)
    return noise.SeparableField(down @ coarse, across)


def _block_means(field: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Means over blocks of `_COARSE` pixels a side. Sums along one axis at a time: avg_pool2d takes thrice
    as long on a single channel."""
    padded = tf.pad(field, [[0, -size[0] % _BLOCK_PX], [0, -size[1] % _BLOCK_PX]])
    rows = tf.reduce_sum(tf.reshape(padded, [-1, _BLOCK_PX, tf.shape(padded)[1]]), axis=1)
    blocks = tf.reduce_sum(tf.reshape(rows, [tf.shape(rows)[0], -1, _BLOCK_PX]), axis=2)
    return blocks * (1 / _BLOCK_PX**2)


def _gaussian_resampling_matrix(
    length: tf.Tensor | int, shift: tf.Tensor | float, spread_px: tf.Tensor
) -> tf.Tensor:
    """Gaussian interpolation weights [length, length / 4]; the sum of a row is one well inside the frame."""
    nodes = (length + _BLOCK_PX - 1) // _BLOCK_PX
    pixels = tf.cast(tf.range(length), tf.float32) + 0.5 - shift
    centres = (tf.cast(tf.range(nodes), tf.float32) + 0.5) * _BLOCK_PX
    spread = tf.maximum(spread_px, 0.6 * _BLOCK_PX)
    distance = (pixels[:, None] - centres[None, :]) / spread
    return tf.exp(-0.5 * distance * distance) * (_BLOCK_PX / (spread * math.sqrt(2 * math.pi)))
