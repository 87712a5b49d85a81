"""Colour: HSV to RGB, luma."""

import tensorflow as tf

LUMA_WEIGHTS = (0.299, 0.587, 0.114)
"""Shares of red, green and blue in luma, as in JPEG (ITU-R BT.601)."""


def hsv_to_rgb(hue: tf.Tensor, saturation: tf.Tensor) -> tf.Tensor:
    """Return the RGB colour [3] of value 1 at `hue` in turns and `saturation` in [0, 1]."""
    wheel = tf.constant([0.0, 2 / 3, 1 / 3]) + hue
    full = tf.clip_by_value(tf.abs((wheel - tf.floor(wheel)) * 6 - 3) - 1, 0, 1)
    return 1 - saturation * (1 - full)


def luma(image: tf.Tensor) -> tf.Tensor:
    """Return the luma [1, H, W] of an RGB image [3, H, W]."""
    red, green, blue = LUMA_WEIGHTS
    return red * image[:1] + green * image[1:2] + blue * image[2:]
