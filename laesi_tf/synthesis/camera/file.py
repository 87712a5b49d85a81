"""What happens to a photo after the sensor: sharpening, compression and resizing.

The 8 x 8 blocks of JPEG can look like a ruling; only the real codec makes them.
"""

import tensorflow as tf

from laesi_tf.synthesis import filters
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.ranges import Scalar

_MAX_SHARPENING_PX = 2.0
"""The halo has taps for this standard deviation."""


def sharpen(image: tf.Tensor, camera: CameraParams[Scalar]) -> tf.Tensor:
    """Sharpen [3, H, W] by an unsharp mask, which leaves halos beside edges, as phones do."""
    soft = filters.gaussian_blur(image, camera.sharpening_px, round(2.5 * _MAX_SHARPENING_PX))
    return image + camera.sharpening * (image - soft)


def compress(image: tf.Tensor, camera: CameraParams[Scalar], components: tuple[str, ...]) -> tf.Tensor:
    """Resize uint8 [H, W, 3], compress it as JPEG and resize it back, where its scene says so.

    Not to be compiled: XLA has no codec, and the size between is known at run time only.
    """
    height, width, _ = image.shape
    is_resized = camera.resized if "resizing" in components else tf.constant(False)
    size = tf.cast(tf.round(tf.constant([height, width], tf.float32) * camera.resize_factor), tf.int32)
    between = tf.cond(is_resized, lambda: _resize(image, size), lambda: image)
    if "jpeg" in components:
        quality = tf.cast(tf.round(camera.jpeg_quality), tf.int32)
        between = tf.cond(
            camera.is_jpeg, lambda: tf.image.adjust_jpeg_quality(between, quality), lambda: between
        )
    after = tf.cond(is_resized, lambda: _resize(between, tf.constant([height, width])), lambda: between)
    return tf.ensure_shape(after, [height, width, 3])


def _resize(image: tf.Tensor, size: tf.Tensor) -> tf.Tensor:
    """Resize uint8 [h, w, 3] to `size` [2], rows and columns, averaging where it shrinks."""
    resized = tf.image.resize(image, size, antialias=True)
    return tf.cast(tf.clip_by_value(resized + 0.5, 0, 255), tf.uint8)
