"""Gaussian blurs: narrow ones at the resolution of the image, wide ones with a shift at a quarter of it."""

import math

import tensorflow as tf

from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.noise import SeparableField

_BLOCK_PX = 4
"""Side in pixels of the blocks whose means the wide blur starts from."""


def gaussian_blur(image: tf.Tensor, sigma_px: tf.Tensor, reach: int) -> tf.Tensor:
    """Blur [..., H, W] by `sigma_px` with 2 * `reach` + 1 taps on each axis."""
    taps = tf.exp(-0.5 * (tf.range(reach + 1, dtype=tf.float32) / tf.maximum(sigma_px, 1e-3)) ** 2)
    taps = tf.unstack(taps / (2 * tf.reduce_sum(taps) - 1))
    return _convolve(_convolve(image, taps, axis=-1), taps, axis=-2)


def _convolve(image: tf.Tensor, taps: list[tf.Tensor], *, axis: int) -> tf.Tensor:
    reach = len(taps) - 1
    length = image.shape[axis]
    first, last = (tf.repeat(tf.gather(image, [end], axis=axis), reach, axis=axis) for end in (0, length - 1))
    # Repeating the border by hand: tf.pad's mirror modes cost more than the convolution.
    padded = tf.concat([first, image, last], axis=axis)

    def shift(offset: int) -> tf.Tensor:
        window = [slice(None)] * image.shape.rank
        window[axis] = slice(reach + offset, reach + offset + length)
        return padded[tuple(window)]

    result = shift(0) * taps[0]
    for offset in range(1, reach + 1):
        result += (shift(offset) + shift(-offset)) * taps[offset]
    return result


def blur_and_shift(
    field: tf.Tensor,
    size: ImageSize,
    sigma_px: tf.Tensor,
    *,
    shift_px: tf.Tensor | tuple[float, float] = (0.0, 0.0),
) -> SeparableField:
    """Blur a field [H, W] by a Gaussian of `sigma_px` and shift it by (x, y) `shift_px`; zeros surround it.

    The field is averaged over blocks of 4 x 4 pixels, then blurred, shifted and interpolated in one product.
    """
    coarse = _block_means(field, size)
    down = _gaussian_resampling_matrix(size[0], shift_px[1], sigma_px)
    across = _gaussian_resampling_matrix(size[1], shift_px[0], sigma_px)
    return SeparableField(down @ coarse, across)


def _block_means(field: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return means over blocks of `_BLOCK_PX` pixels a side.

    Sums along one axis at a time: avg_pool2d takes three times as long on a single channel.
    """
    padded = tf.pad(field, [[0, -size[0] % _BLOCK_PX], [0, -size[1] % _BLOCK_PX]])
    rows = tf.reduce_sum(tf.reshape(padded, [-1, _BLOCK_PX, tf.shape(padded)[1]]), axis=1)
    blocks = tf.reduce_sum(tf.reshape(rows, [tf.shape(rows)[0], -1, _BLOCK_PX]), axis=2)
    return blocks * (1 / _BLOCK_PX**2)


def _gaussian_resampling_matrix(
    length: tf.Tensor | int, shift_px: tf.Tensor | float, sigma_px: tf.Tensor
) -> tf.Tensor:
    """Return interpolation weights [length, length / 4]; a row well inside of the image sums to one."""
    nodes = (length + _BLOCK_PX - 1) // _BLOCK_PX
    pixels = tf.cast(tf.range(length), tf.float32) + 0.5 - shift_px
    centres = (tf.cast(tf.range(nodes), tf.float32) + 0.5) * _BLOCK_PX
    sigma = tf.maximum(sigma_px, 0.6 * _BLOCK_PX)
    distance = (pixels[:, None] - centres[None, :]) / sigma
    return tf.exp(-0.5 * distance * distance) * (_BLOCK_PX / (sigma * math.sqrt(2 * math.pi)))
