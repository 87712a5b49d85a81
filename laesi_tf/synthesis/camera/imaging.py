"""Lens, sensor and file: focus blur, white balance and tone, sensor noise, chroma subsampling.

Images are planar, [3, H, W] in [0, 1]: on a CPU several times faster than channels last.
"""

import functools
import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.colour import LUMA_WEIGHTS, luma
from laesi_tf.synthesis.filters import gaussian_blur
from laesi_tf.synthesis.geometry import ImageSize

_MAX_BLUR_MM = 0.25
"""Taps of the blur are laid out for this much; a wider one is cut off."""


def apply_focus_blur(image: tf.Tensor, camera: CameraParams, px_per_mm: tf.Tensor) -> tf.Tensor:
    """Focus blur of [3, H, W] where the scene has it."""
    reach = math.ceil(1.25 * _MAX_BLUR_MM * max(image.shape[1:]) / 70)
    return tf.cond(
        camera.blurred, lambda: gaussian_blur(image, camera.blur_mm * px_per_mm, reach), lambda: image
    )


def subsample_chroma(image: tf.Tensor) -> tf.Tensor:
    """Means [3, ceil(H / 2), ceil(W / 2)] of colour less luma over blocks of two by two pixels."""
    _, height, width = image.shape
    last = tf.concat([image, image[:, -1:]], axis=1) if height % 2 else image
    even = tf.concat([last, last[:, :, -1:]], axis=2) if width % 2 else last
    corners = [even[:, row::2, column::2] for row in (0, 1) for column in (0, 1)]
    mean = (corners[0] + corners[1] + corners[2] + corners[3]) / 4
    return mean - luma(mean)


def restore_chroma(image: tf.Tensor, chroma: tf.Tensor) -> tf.Tensor:
    """Luma of `image` [3, H, W] with half-size `chroma` interpolated bilinearly to its size.

    Of an image and its own `halved_chroma` it makes what JPEG does (4:2:0 subsampling): softer colour.
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


def apply_white_balance_and_tone(image: tf.Tensor, camera: CameraParams, paper: tf.Tensor) -> tf.Tensor:
    """White balance, exposure, contrast and saturation of [3, H, W]: one affine map of colour.

    The exposure is metered on the bare `paper`, its colour [3, 1, 1].
    """
    balance = tf.stack([1 + camera.warmth / 2, 1 + camera.green, 1 - camera.warmth / 2])
    gains = balance * (camera.exposure / tf.reduce_max(balance * paper[:, 0, 0]))
    mix = camera.saturation * tf.eye(3) + (1 - camera.saturation) * tf.constant([LUMA_WEIGHTS] * 3)
    matrix = camera.contrast * mix * gains[None, :]
    mixed = sum(matrix[:, channel, None, None] * image[channel] for channel in range(3))
    return mixed + 0.5 * (1 - camera.contrast)


def add_sensor_noise(image: tf.Tensor, camera: CameraParams, grain: tf.Tensor) -> tf.Tensor:
    """Sensor noise on [3, H, W], stronger in the shadows as a tone curve makes it.

    `grain` [3, H, W] has unit variance.
    """
    return image + camera.noise * (1.25 - 0.6 * image[1]) * grain


@functools.cache
def _sensor_noise_bank(side: int) -> np.ndarray:
    """Unit normal noise [3, side, side]; its channels share most of their variance, as after demosaicing."""
    normal = np.random.default_rng(20240400593).standard_normal((4, side, side)).astype(np.float32)
    return 0.85 * normal[:1] + 0.53 * normal[1:]


def cut_sensor_noise(offset: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Noise [3, H, W] of unit variance, cut at uniform `offset` [2] in [0, 1) from one fixed bank.

    Drawing 150,000 fresh normals costs more than the rest of the camera; a random window of a bank 256 pixels
    wider than the picture looks the same to anything that sees one picture at a time. Not to be compiled:
    that makes the cut cost a thousand times as much.
    """
    slack = 256
    bank = tf.constant(_sensor_noise_bank(max(size) + slack))
    return tf.slice(bank, tf.concat([[0], tf.cast(offset * slack, tf.int32)], 0), [3, *size])
