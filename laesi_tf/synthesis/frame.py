"""Which part of a picture is drawn: all of it, or the window that the leaf covers."""

from typing import NamedTuple

import tensorflow as tf

Size = tuple[int, int]
_STEP = 32


class Frame(NamedTuple):
    """A rectangle of pixels, sides as ints or int32 scalars; `longest` is the whole picture's longer side."""

    height: tf.Tensor | int
    width: tf.Tensor | int
    longest: int


class Window(NamedTuple):
    """A frame and the corner (`top`, `left`) at which it lies in the picture."""

    top: tf.Tensor
    left: tf.Tensor
    frame: Frame

    @property
    def corner(self) -> tf.Tensor:
        """Top left corner [2] (x, y) in pixels."""
        return tf.cast(tf.stack([self.left, self.top]), tf.float32)

    def cut(self, image: tf.Tensor) -> tf.Tensor:
        """The window's part of an image [3, H, W]."""
        return tf.slice(image, [0, self.top, self.left], [3, self.frame.height, self.frame.width])

    def paste(self, field: tf.Tensor, size: Size) -> tf.Tensor:
        """A field [..., h, w] of the window in a picture [..., H, W] of zeros."""
        below = size[0] - self.top - self.frame.height
        beside = size[1] - self.left - self.frame.width
        padding = [[0, 0]] * (field.shape.rank - 2) + [[self.top, below], [self.left, beside]]
        return tf.ensure_shape(tf.pad(field, padding), [*field.shape[:-2], *size])


def whole(size: Size) -> Frame:
    """The frame of a whole picture."""
    return Frame(*size, longest=max(size))


def window(low: tf.Tensor, high: tf.Tensor, size: Size) -> Window:
    """A window of a picture around the box from `low` to `high` [2] (x, y) in pixels.

    Its sides are multiples of 32 where the picture is large enough: libraries that compile a kernel for each
    shape then meet few of them.
    """
    frame_size = tf.constant([size[1], size[0]])
    corner = tf.clip_by_value(tf.cast(tf.floor(low), tf.int32), 0, frame_size - 1)
    extent = tf.maximum(tf.cast(tf.math.ceil(high), tf.int32) - corner, 1)
    extent = tf.minimum((extent + _STEP - 1) // _STEP * _STEP, frame_size)
    left, top = tf.unstack(tf.minimum(corner, frame_size - extent))
    width, height = tf.unstack(extent)
    return Window(top, left, Frame(height, width, max(size)))
