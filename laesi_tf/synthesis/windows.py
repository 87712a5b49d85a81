"""Sub-windows of an image: what is small is drawn only in the pixels that it may cover."""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis.geometry import ImageSize

_STEP = 32


class Window(NamedTuple):
    """A rectangle of an image's pixels, int32 scalars."""

    top: tf.Tensor
    left: tf.Tensor
    height: tf.Tensor
    width: tf.Tensor

    @property
    def corner(self) -> tf.Tensor:
        """Top left corner [2] (x, y) in pixels."""
        return tf.cast(tf.stack([self.left, self.top]), tf.float32)

    @property
    def size(self) -> tuple[tf.Tensor, tf.Tensor]:
        """Height and width."""
        return self.height, self.width

    def crop(self, image: tf.Tensor) -> tf.Tensor:
        """Return the window's part of an image [3, H, W]."""
        return tf.slice(image, [0, self.top, self.left], [3, self.height, self.width])

    def pad_to_image(self, crop: tf.Tensor, size: ImageSize) -> tf.Tensor:
        """Return an image [3, H, W] of zeros with `crop` [3, h, w] in the window."""
        below, right = size[0] - self.top - self.height, size[1] - self.left - self.width
        padding = [[0, 0], [self.top, below], [self.left, right]]
        return tf.ensure_shape(tf.pad(crop, padding), [3, *size])


def window_around(low: tf.Tensor, high: tf.Tensor, image_wh: tf.Tensor) -> Window:
    """Return the window around the box from `low` [2] to `high` [2], (x, y) in pixels.

    `image_wh` [2] is the image's width and height in pixels.
    Its sides are multiples of 32 where the image is large enough: libraries that compile a kernel for each
    shape then meet few shapes.
    """
    sides = tf.cast(image_wh, tf.int32)
    corner = tf.clip_by_value(tf.cast(tf.floor(low), tf.int32), 0, sides - 1)
    extent = tf.maximum(tf.cast(tf.math.ceil(high), tf.int32) - corner, 1)
    extent = tf.minimum((extent + _STEP - 1) // _STEP * _STEP, sides)
    left, top = tf.unstack(tf.minimum(corner, sides - extent))
    width, height = tf.unstack(extent)
    return Window(top, left, height, width)
