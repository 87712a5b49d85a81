"""Exposure, lens, sensor and file: illumination, tone, focus blur, sensor noise, chroma subsampling.

Images are planar, [3, H, W] in [0, 1], which on a CPU is several times faster than channels last.
"""

import functools
import math

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import light as lighting
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.paper.sheet import sheet_colour
from laesi_tf.synthesis.ranges import Scalar

LUMA_WEIGHTS = (0.299, 0.587, 0.114)
"""Shares of red, green and blue in luma, as in JPEG (ITU-R BT.601)."""
_MAX_BLUR_MM = 0.25
"""The blur has taps for this standard deviation; a wider one is cut off."""
_BANK_MARGIN_PX = 256


def apply_light_and_tone(
    image: tf.Tensor,
    light: LightParams[Scalar],
    illumination_grid: tf.Tensor,
    camera: CameraParams[Scalar],
    paper: PaperParams[Scalar],
    components: tuple[str, ...],
) -> tf.Tensor:
    """Illuminate [3, H, W], add the reflection of a pane of glass, and apply white balance and tone.

    Apart from the stages before it: each channel of the result needs all three channels of `image`.
    """
    size = image.shape[1], image.shape[2]
    if "illumination" in components:
        image *= lighting.illumination(light, illumination_grid, size)
    if "photographer" in components:
        image *= lighting.photographer_shadow(light, size)
    if "glass" in components:
        image = lighting.add_glass_reflection(image, lighting.glass_reflection(light, size))
    if "glare" in components:
        image = lighting.add_glass_reflection(image, lighting.glare_reflection(light, size))
    if "development" in components:
        image = apply_white_balance_and_tone(image, camera, sheet_colour(paper))
    return image


def apply_white_balance_and_tone(
    image: tf.Tensor, camera: CameraParams[Scalar], bare_sheet: tf.Tensor
) -> tf.Tensor:
    """Apply white balance, exposure, contrast and saturation to [3, H, W]: one affine map of colour.

    The exposure is metered on the colour `bare_sheet` [3, 1, 1].
    """
    balance = tf.stack([1 + camera.warmth / 2, 1 + camera.green, 1 - camera.warmth / 2])
    gains = balance * (camera.exposure / tf.reduce_max(balance * bare_sheet[:, 0, 0]))
    mix = camera.saturation * tf.eye(3) + (1 - camera.saturation) * tf.constant([LUMA_WEIGHTS] * 3)
    matrix = camera.contrast * mix * gains[None, :]
    mixed = sum(matrix[:, channel, None, None] * image[channel] for channel in range(3))
    return mixed + 0.5 * (1 - camera.contrast)


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


def apply_focus_blur(
    image: tf.Tensor, camera: CameraParams[Scalar], px_per_mm: tf.Tensor, closest_mm: float
) -> tf.Tensor:
    """Blur [3, H, W] by the camera's defocus; `closest_mm` is the width of the closest view."""
    reach = math.ceil(1.25 * _MAX_BLUR_MM * max(image.shape[1:]) / closest_mm)
    return gaussian_blur(image, camera.blur_mm * px_per_mm, reach)


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
