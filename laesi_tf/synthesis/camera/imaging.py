"""Exposure and lens: illumination, tone, focus blur.

Images are planar, [3, H, W] in [0, 1], which on a CPU is several times faster than channels last.
"""

import math

import tensorflow as tf

from laesi_tf.synthesis import filters
from laesi_tf.synthesis import light as lighting
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.camera.recording import LUMA_WEIGHTS
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.paper.sheet import sheet_colour
from laesi_tf.synthesis.ranges import Scalar

_MAX_BLUR_MM = 0.25
"""The blur has taps for this standard deviation; a wider one is cut off."""


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


def apply_focus_blur(
    image: tf.Tensor, camera: CameraParams[Scalar], px_per_mm: tf.Tensor, closest_mm: float
) -> tf.Tensor:
    """Blur [3, H, W] by the camera's defocus; `closest_mm` is the width of the closest view."""
    reach = math.ceil(1.25 * _MAX_BLUR_MM * max(image.shape[1:]) / closest_mm)
    return filters.gaussian_blur(image, camera.blur_mm * px_per_mm, reach)
