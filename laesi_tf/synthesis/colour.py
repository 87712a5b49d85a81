"""Colours from hue and saturation."""

import tensorflow as tf


def hsv_to_rgb(hue: tf.Tensor, saturation: tf.Tensor) -> tf.Tensor:
    """Return the RGB colour [3] of value 1 at `hue` in turns and `saturation` in [0, 1]."""
    wheel = tf.constant([0.0, 2 / 3, 1 / 3]) + hue
    full = tf.clip_by_value(tf.abs((wheel - tf.floor(wheel)) * 6 - 3) - 1, 0, 1)
    return 1 - saturation * (1 - full)
