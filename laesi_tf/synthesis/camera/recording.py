"""What a camera records: sensor noise, chroma at half the resolution, 8 bits.

Images are planar, [3, H, W] in [0, 1].
"""

import functools

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.ranges import Scalar

LUMA_WEIGHTS = (0.299, 0.587, 0.114)
"""Shares of red, green and blue in luma, as in JPEG (ITU-R BT.601)."""
_BANK_MARGIN_PX = 256


def cut_sensor_noise(offset: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Return noise [3, H, W] of unit variance, the window at `offset` [2] in [0, 1) of one fixed bank.

    Drawing 150,000 fresh normals costs more than the rest of the camera; a random window of a bank 256 pixels
    wider than the image looks the same to anything that sees one image at a time. Not to be compiled: XLA
    makes the cut cost a thousand times as much.
    """
    bank = tf.constant(_sensor_noise_bank(max(size) + _BANK_MARGIN_PX))
    return tf.slice(bank, tf.concat([[0], tf.cast(offset * _BANK_MARGIN_PX, tf.int32)], 0), [3, *size])


@functools.cache
def _sensor_noise_bank(side: int) -> np.ndarray:
    """Return normal noise [3, side, side]; channels share most of their variance, as after demosaicing."""
    normal = np.random.default_rng(20240400593).standard_normal((4, side, side)).astype(np.float32)
    return 0.85 * normal[:1] + 0.53 * normal[1:]


def add_sensor_noise(image: tf.Tensor, camera: CameraParams[Scalar], noise: tf.Tensor | None) -> tf.Tensor:
    """Add sensor `noise` [3, H, W] of unit variance to [3, H, W]: more in shadows, as a tone curve does."""
    return image if noise is None else image + camera.noise * (1.25 - 0.6 * image[1]) * noise


def record(image: tf.Tensor, camera: CameraParams[Scalar], noise: tf.Tensor | None) -> tf.Tensor:
    """Add sensor noise and quantise: uint8 [H, W, 3]."""
    return quantise(add_sensor_noise(image, camera, noise))


def subsample_chroma(
    image: tf.Tensor, camera: CameraParams[Scalar], noise: tf.Tensor | None
) -> tuple[tf.Tensor, tf.Tensor]:
    """Add sensor noise; return the noisy image and its chroma at half the resolution, as JPEG files store it.

    The chroma [3, ceil(H / 2), ceil(W / 2)] is colour less luma, averaged over blocks of two by two pixels.
    """
    image = add_sensor_noise(image, camera, noise)
    return image, halve_chroma(image)


def halve_chroma(image: tf.Tensor) -> tf.Tensor:
    """Return the mean chroma [3, ceil(H / 2), ceil(W / 2)], colour less luma, of blocks of 2 x 2 pixels."""
    _, height, width = image.shape
    last = tf.concat([image, image[:, -1:]], axis=1) if height % 2 else image
    even = tf.concat([last, last[:, :, -1:]], axis=2) if width % 2 else last
    corners = [even[:, row::2, column::2] for row in (0, 1) for column in (0, 1)]
    mean = (corners[0] + corners[1] + corners[2] + corners[3]) / 4
    return mean - luma(mean)


def luma(image: tf.Tensor) -> tf.Tensor:
    """Return the luma [1, H, W] of an RGB image [3, H, W]."""
    red, green, blue = LUMA_WEIGHTS
    return red * image[:1] + green * image[1:2] + blue * image[2:]


def record_with_chroma(image: tf.Tensor, chroma: tf.Tensor) -> tf.Tensor:
    """Replace the chroma of `image` [3, H, W] by half-size `chroma` and quantise: uint8 [H, W, 3]."""
    return quantise(restore_chroma(image, chroma))


def restore_chroma(image: tf.Tensor, chroma: tf.Tensor) -> tf.Tensor:
    """Return the luma of `image` [3, H, W] with half-size `chroma`, bilinearly interpolated to its size.

    Of an image and its own `halve_chroma` it makes what JPEG does (4:2:0 subsampling): softer colour.
    """
    for axis in (1, 2):
        length = chroma.shape[axis]
        first, rest = tf.split(chroma, [1, length - 1], axis)
        before = tf.concat([first, tf.split(chroma, [length - 1, 1], axis)[0]], axis)
        after = tf.concat([rest, tf.split(chroma, [length - 1, 1], axis)[1]], axis)
        pair = tf.stack([0.75 * chroma + 0.25 * before, 0.75 * chroma + 0.25 * after], axis + 1)
        shape = chroma.shape.as_list()
        chroma = tf.reshape(pair, [*shape[:axis], 2 * length, *shape[axis + 1 :]])
    return luma(image) + chroma[:, : image.shape[1], : image.shape[2]]


def quantise(image: tf.Tensor) -> tf.Tensor:
    """Round [3, H, W] in [0, 1] to uint8 [H, W, 3]."""
    return tf.cast(tf.transpose(tf.clip_by_value(image * 255 + 0.5, 0, 255), [1, 2, 0]), tf.uint8)
