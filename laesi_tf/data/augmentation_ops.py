"""The paper's nine augmentations (section 4.2), each one function of a sample and a seed.

Of a sample (see `laesi_tf.data.sample`) only `image` is needed, here float32 [H, W, 3] within 0..255, and the
result stays within. Photometric functions change nothing but the image. Geometric ones also transform `mask`,
`to_px` and `px_per_mm` if the sample has them; the area does not change, since the ruling moves with the
leaf. Every random number comes from `seed`, int [2].

The paper gives no strengths; those below are this project's.
"""

import math
from collections.abc import Callable

import numpy as np
import tensorflow as tf

from laesi_tf.data.sample import Sample

Augmentation = Callable[[Sample, tf.Tensor], Sample]

BRIGHTNESS = (-40.0, 40.0)
"""Added to every value, which is 0..255."""
CONTRAST = (0.7, 1.3)
"""Factor on the distance from each channel's mean."""
HUE = (-0.06, 0.06)
"""Rotation of the colour wheel, in full turns."""
SATURATION = (0.6, 1.4)
"""Factor on the saturation of HSV."""
GAUSSIAN = (0.0, 10.0)
"""Standard deviation of the noise."""
PHOTONS = (0.4, 8.0)
"""Photons per unit of value, uniform in the logarithm: noise of 25 down to 6 at full white."""


def random_uniform(seed: tf.Tensor, low: float, high: float) -> tf.Tensor:
    """Draw a float32 scalar from the uniform distribution between `low` and `high`."""
    return tf.random.stateless_uniform([], seed, low, high)


def adjust_brightness(sample: Sample, seed: tf.Tensor) -> Sample:
    """Add one number to every value."""
    return _replace_image(sample, sample["image"] + random_uniform(seed, *BRIGHTNESS))


def adjust_contrast(sample: Sample, seed: tf.Tensor) -> Sample:
    """Scale every channel's distance from its mean."""
    factor = random_uniform(seed, *CONTRAST)
    return _replace_image(sample, tf.image.adjust_contrast(sample["image"], factor))


def shift_hue(sample: Sample, seed: tf.Tensor) -> Sample:
    """Rotate the hue of every pixel by one angle."""
    turns = random_uniform(seed, *HUE)
    return _replace_image(sample, 255 * tf.image.adjust_hue(sample["image"] / 255, turns))


def adjust_saturation(sample: Sample, seed: tf.Tensor) -> Sample:
    """Scale the saturation of every pixel."""
    factor = random_uniform(seed, *SATURATION)
    return _replace_image(sample, 255 * tf.image.adjust_saturation(sample["image"] / 255, factor))


def flip_left_right(sample: Sample, seed: tf.Tensor) -> Sample:
    """Mirror half of the images left to right; with `rotate_quarter_turns`, also upside down."""
    width = float(sample["image"].shape[1])
    mirror = np.array([[-1, 0, width], [0, 1, 0], [0, 0, 1]], np.float32)

    def flip() -> Sample:
        return _transform_sample(sample, lambda field: tf.reverse(field, [1]), tf.constant(mirror))

    return tf.cond(random_uniform(seed, 0, 1) < 0.5, flip, lambda: dict(sample))


def rotate_quarter_turns(sample: Sample, seed: tf.Tensor) -> Sample:
    """Rotate by 0, 90, 180 or 270 degrees; an image that is not square by 0 or 180, to keep its shape."""
    height, width = sample["image"].shape[:2]
    increment = 1 if height == width else 2
    quarters = increment * tf.cast(random_uniform(seed, 0, 4 // increment), tf.int32)
    angle = tf.cast(quarters, tf.float32) * (-math.pi / 2)

    def turn(field: tf.Tensor) -> tf.Tensor:
        planes = field if field.shape.rank == 3 else field[..., None]
        return tf.reshape(tf.image.rot90(planes, quarters), field.shape)

    return _transform_sample(sample, turn, _rotation_matrix(angle, (height, width), tf.constant(1.0)))


def rotate(sample: Sample, seed: tf.Tensor) -> Sample:
    """Rotate by any angle about the centre and shrink, so that the whole image stays visible.

    Nothing is cut off, since a leaf may reach anywhere and the label counts all of it. The corners get the
    median colour along the border: repeated or mirrored paper would show a ruling that does not exist and
    duplicate a leaf near the border, whereas a plain area beyond a straight edge is what scenes show where a
    sheet ends, and how photos are letterboxed for a network.
    """
    height, width = sample["image"].shape[:2]
    angle = random_uniform(seed, -math.pi, math.pi)
    cosine, sine = tf.abs(tf.cos(angle)), tf.abs(tf.sin(angle))
    zoom = tf.minimum(width / (width * cosine + height * sine), height / (width * sine + height * cosine))
    matrix = _rotation_matrix(angle, (height, width), zoom)

    def turn(field: tf.Tensor) -> tf.Tensor:
        if field.shape.rank == 2:
            warped = _warp_image(tf.cast(field, tf.float32)[..., None], matrix)[..., 0]
            return tf.cast(warped + 0.5, field.dtype)
        background = _border_median(field)
        return background + _warp_image(field - background, matrix)

    return _transform_sample(sample, turn, matrix)


def add_gaussian_noise(sample: Sample, seed: tf.Tensor) -> Sample:
    """Add noise of equal strength everywhere, as from a sensor's electronics."""
    strength_seed, noise_seed = tf.unstack(tf.random.split(seed, 2))
    noise = tf.random.stateless_normal(sample["image"].shape, noise_seed)
    return _replace_image(sample, sample["image"] + random_uniform(strength_seed, *GAUSSIAN) * noise)


def add_poisson_noise(sample: Sample, seed: tf.Tensor) -> Sample:
    """Count photons: the noise grows with the square root of the light, as in a dim room."""
    strength_seed, noise_seed = tf.unstack(tf.random.split(seed, 2))
    photons = tf.exp(random_uniform(strength_seed, math.log(PHOTONS[0]), math.log(PHOTONS[1])))
    image = sample["image"]
    counts = tf.random.stateless_poisson(image.shape, noise_seed, image * photons, tf.float32)
    return _replace_image(sample, counts / photons)


def _replace_image(sample: Sample, image: tf.Tensor) -> Sample:
    return sample | {"image": tf.clip_by_value(image, 0, 255)}


def _transform_sample(
    sample: Sample, transform: Callable[[tf.Tensor], tf.Tensor], matrix: tf.Tensor
) -> Sample:
    """Apply `transform` to image and mask of `sample`, and the same as `matrix` [3, 3] to its geometry.

    `matrix` maps homogeneous pixel coordinates (x, y, 1) before the transformation to those after it.
    """
    transformed = sample | {name: transform(sample[name]) for name in ("image", "mask") if name in sample}
    if "px_per_mm" in sample:
        transformed["px_per_mm"] = sample["px_per_mm"] * tf.sqrt(tf.abs(tf.linalg.det(matrix)))
    if "to_px" in sample:
        transformed["to_px"] = matrix @ sample["to_px"]
    return transformed


def _rotation_matrix(angle: tf.Tensor, size: tuple[int, int], zoom: tf.Tensor) -> tf.Tensor:
    """Return the matrix [3, 3] that rotates points (x, y) of an image about its centre and zooms.

    `angle` is in radians, clockwise on screen; pixel centres are at halves.
    """
    centre = np.array([size[1] / 2, size[0] / 2], np.float32)
    cosine, sine = zoom * tf.cos(angle), zoom * tf.sin(angle)
    linear = tf.stack([tf.stack([cosine, -sine]), tf.stack([sine, cosine])])
    shift = centre - tf.linalg.matvec(linear, tf.constant(centre))
    return tf.concat([tf.concat([linear, shift[:, None]], axis=1), [[0.0, 0.0, 1.0]]], axis=0)


def _warp_image(image: tf.Tensor, matrix: tf.Tensor) -> tf.Tensor:
    """Warp `image` float32 [H, W, C] by `matrix` [3, 3], bilinear, zero beyond its border."""
    return warp_images(image[None], tf.linalg.inv(matrix)[None])[0]


def warp_images(images: tf.Tensor, to_source: tf.Tensor) -> tf.Tensor:
    """Return `images` float32 [B, H, W, C] warped, bilinear, zero beyond their borders.

    `to_source` [B, 3, 3] are the matrices from points of the result to those of the images.
    """
    # The op maps output indices to input indices, which are the positions of pixel centres minus one half.
    index_to_point = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], np.float32)
    to_index = tf.constant(np.linalg.inv(index_to_point)) @ to_source @ tf.constant(index_to_point)
    warped = tf.raw_ops.ImageProjectiveTransformV3(
        images=images,
        transforms=tf.reshape(to_index, [-1, 9])[:, :8],
        output_shape=images.shape[1:3],
        interpolation="BILINEAR",
        fill_mode="CONSTANT",
        fill_value=0.0,
    )
    return tf.ensure_shape(warped, images.shape)


def _border_median(image: tf.Tensor) -> tf.Tensor:
    """Return the median colour [3] of the outermost pixels of [H, W, 3]."""
    border = tf.concat([image[0], image[-1], image[:, 0], image[:, -1]], axis=0)
    return tf.sort(border, axis=0)[border.shape[0] // 2]
