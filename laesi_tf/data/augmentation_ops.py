"""The paper's nine augmentations (section 4.2), each one function of a sample and a seed."""

import math
from collections.abc import Callable

import numpy as np
import tensorflow as tf

Sample = dict[str, tf.Tensor]
Augmentation = Callable[[Sample, tf.Tensor], Sample]

BRIGHTNESS = (-40.0, 40.0)
"""Added to every value."""
CONTRAST = (0.7, 1.3)
"""Factor on the distance from each channel's mean."""
HUE = (-0.06, 0.06)
"""Turns of the colour wheel."""
SATURATION = (0.6, 1.4)
"""Factor on the saturation of HSV."""
GAUSSIAN = (0.0, 10.0)
"""Standard deviation of the noise."""
PHOTONS = (0.4, 8.0)
"""Photons per unit of value, drawn uniformly in the logarithm: noise of 25 down to 6 at full white."""


def random_uniform(seed: tf.Tensor, low: float, high: float) -> tf.Tensor:
    """A float32 scalar, uniform between `low` and `high`."""
    return tf.random.stateless_uniform([], seed, low, high)


def adjust_brightness(picture: Sample, seed: tf.Tensor) -> Sample:
    """Add the same to every value."""
    return _clip_image(picture, picture["image"] + random_uniform(seed, *BRIGHTNESS))


def adjust_contrast(picture: Sample, seed: tf.Tensor) -> Sample:
    """Stretch every channel about its mean."""
    return _clip_image(picture, tf.image.adjust_contrast(picture["image"], random_uniform(seed, *CONTRAST)))


def shift_hue(picture: Sample, seed: tf.Tensor) -> Sample:
    """Turn the colour wheel."""
    return _clip_image(picture, 255 * tf.image.adjust_hue(picture["image"] / 255, random_uniform(seed, *HUE)))


def adjust_saturation(picture: Sample, seed: tf.Tensor) -> Sample:
    """Make colours paler or stronger."""
    factor = random_uniform(seed, *SATURATION)
    return _clip_image(picture, 255 * tf.image.adjust_saturation(picture["image"] / 255, factor))


def flip_left_right(picture: Sample, seed: tf.Tensor) -> Sample:
    """Mirror half of the pictures left to right; turned upside down they come by quarter turns."""
    width = float(picture["image"].shape[1])
    mirror = np.array([[-1, 0, width], [0, 1, 0], [0, 0, 1]], np.float32)

    def mirrored() -> Sample:
        return _transform_sample(picture, lambda field: tf.reverse(field, [1]), tf.constant(mirror))

    return tf.cond(random_uniform(seed, 0, 1) < 0.5, mirrored, lambda: dict(picture))


def rotate_quarter_turns(picture: Sample, seed: tf.Tensor) -> Sample:
    """Turn by 0, 90, 180 or 270 degrees; a picture that is not square by 0 or 180, which keep its shape."""
    height, width = picture["image"].shape[:2]
    step = 1 if height == width else 2
    quarters = step * tf.cast(random_uniform(seed, 0, 4 // step), tf.int32)
    angle = tf.cast(quarters, tf.float32) * (-math.pi / 2)

    def turned(field: tf.Tensor) -> tf.Tensor:
        planes = field if field.shape.rank == 3 else field[..., None]
        return tf.reshape(tf.image.rot90(planes, quarters), field.shape)

    return _transform_sample(picture, turned, _rotation_matrix(angle, (height, width), tf.constant(1.0)))


def rotate(picture: Sample, seed: tf.Tensor) -> Sample:
    """Turn by any angle about the middle, shrunk so that the whole picture stays in the frame.

    Nothing is cut off, since a leaf may reach anywhere and the label counts all of it. The corners are filled
    with the median colour along the border: repeated or mirrored paper would show a ruling that is not
    there and double a leaf near the border, whereas a plain ground beyond a straight edge is what scenes
    show where a sheet ends, and how photos of other shapes are fitted into a network's input.
    """
    size = picture["image"].shape[0], picture["image"].shape[1]
    angle = random_uniform(seed, -math.pi, math.pi)
    cosine, sine = tf.abs(tf.cos(angle)), tf.abs(tf.sin(angle))
    height, width = size
    shrink = tf.minimum(width / (width * cosine + height * sine), height / (width * sine + height * cosine))
    matrix = _rotation_matrix(angle, size, shrink)

    def turned(field: tf.Tensor) -> tf.Tensor:
        if field.shape.rank == 2:
            warped = _warp_image(tf.cast(field, tf.float32)[..., None], matrix)[..., 0]
            return tf.cast(warped + 0.5, field.dtype)
        ground = _border_median(field)
        return ground + _warp_image(field - ground, matrix)

    return _transform_sample(picture, turned, matrix)


def add_gaussian_noise(picture: Sample, seed: tf.Tensor) -> Sample:
    """Noise of equal strength everywhere, as from a sensor's electronics."""
    strength, field = tf.unstack(tf.random.split(seed, 2))
    normal = tf.random.stateless_normal(picture["image"].shape, field)
    return _clip_image(picture, picture["image"] + random_uniform(strength, *GAUSSIAN) * normal)


def add_poisson_noise(picture: Sample, seed: tf.Tensor) -> Sample:
    """Counted photons: noise that grows with the root of the light, as in a dim room."""
    strength, field = tf.unstack(tf.random.split(seed, 2))
    photons = tf.exp(random_uniform(strength, math.log(PHOTONS[0]), math.log(PHOTONS[1])))
    image = picture["image"]
    counted = tf.random.stateless_poisson(image.shape, field, image * photons, tf.float32)
    return _clip_image(picture, counted / photons)


def _clip_image(picture: Sample, image: tf.Tensor) -> Sample:
    return picture | {"image": tf.clip_by_value(image, 0, 255)}


def _transform_sample(picture: Sample, move: Callable[[tf.Tensor], tf.Tensor], matrix: tf.Tensor) -> Sample:
    """`picture` with its fields through `move`, which takes pixels to `matrix` [3, 3] times them."""
    moved = picture | {name: move(picture[name]) for name in ("image", "mask") if name in picture}
    if "px_per_mm" in picture:
        moved["px_per_mm"] = picture["px_per_mm"] * tf.sqrt(tf.abs(tf.linalg.det(matrix)))
    if "to_px" in picture:
        moved["to_px"] = matrix @ picture["to_px"]
    return moved


def _rotation_matrix(angle: tf.Tensor, size: tuple[int, int], zoom: tf.Tensor) -> tf.Tensor:
    """Matrix [3, 3] that turns pixels, their centres at halves, by `angle` about the middle and zooms."""
    middle = np.array([size[1] / 2, size[0] / 2], np.float32)
    cosine, sine = zoom * tf.cos(angle), zoom * tf.sin(angle)
    linear = tf.stack([tf.stack([cosine, -sine]), tf.stack([sine, cosine])])
    shift = middle - tf.linalg.matvec(linear, tf.constant(middle))
    return tf.concat([tf.concat([linear, shift[:, None]], axis=1), [[0.0, 0.0, 1.0]]], axis=0)


def _warp_image(field: tf.Tensor, matrix: tf.Tensor) -> tf.Tensor:
    """`field` [H, W, C] through `matrix` [3, 3], bilinear, zero beyond its border."""
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], np.float32)
    # The op takes output indices to input indices, whose centres are at whole numbers.
    back = tf.constant(np.linalg.inv(half)) @ tf.linalg.inv(matrix) @ tf.constant(half)
    warped = tf.raw_ops.ImageProjectiveTransformV3(
        images=field[None],
        transforms=tf.reshape(back, [1, 9])[:, :8],
        output_shape=field.shape[:2],
        interpolation="BILINEAR",
        fill_mode="CONSTANT",
        fill_value=0.0,
    )
    return tf.ensure_shape(warped[0], field.shape)


def _border_median(image: tf.Tensor) -> tf.Tensor:
    """Median colour [3] of the outermost pixels of [H, W, 3]."""
    border = tf.concat([image[0], image[-1], image[:, 0], image[:, -1]], axis=0)
    return tf.sort(border, axis=0)[border.shape[0] // 2]
