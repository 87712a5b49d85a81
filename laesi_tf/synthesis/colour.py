"""Colour spaces: HSV to RGB, luma."""

import tensorflow as tf

LUMA_WEIGHTS = (0.299, 0.587, 0.114)


def luma(image: tf.Tensor) -> tf.Tensor:
    return LUMA_WEIGHTS[0] * image[:1] + LUMA_WEIGHTS[1] * image[1:2] + LUMA_WEIGHTS[2] * image[2:]


def hsv_to_rgb(hue: tf.Tensor, saturation: tf.Tensor) -> tf.Tensor:
    """Colour of full value [3] (HSV) at `hue` in turns and `saturation` in [0, 1]."""
    wheel = tf.constant([0.0, 2 / 3, 1 / 3]) + hue
    full = tf.clip_by_value(tf.abs((wheel - tf.floor(wheel)) * 6 - 3) - 1, 0, 1)
    return 1 - saturation * (1 - full)
