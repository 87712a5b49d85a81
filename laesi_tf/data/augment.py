"""The paper's nine augmentations (section 4.2), each one function over the picture dict.

A picture is what `laesi_tf.data.synthetic.pictures` yields, of which only `image` is needed; here `image` is
float32 [H, W, 3] in 0..255 and stays within it. Photometric functions change nothing but the image. Geometric
ones move `mask`, `to_px` and `px_per_mm` along where the picture has them; the area stays what it is, as the
ruling moves with the leaf. Each draws what it needs from `seed`, int [2], and from nothing else.

The strengths are this project's: the paper gives none.
"""

import math
from collections.abc import Callable, Iterable

import numpy as np
import tensorflow as tf

from laesi_tf.errors import InputError

Picture = dict[str, tf.Tensor]
Augmentation = Callable[[Picture, tf.Tensor], Picture]

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


def draw(seed: tf.Tensor, low: float, high: float) -> tf.Tensor:
    """A float32 scalar, uniform between `low` and `high`."""
    return tf.random.stateless_uniform([], seed, low, high)


def brightness(picture: Picture, seed: tf.Tensor) -> Picture:
    """Add the same to every value."""
    return _shown(picture, picture["image"] + draw(seed, *BRIGHTNESS))


def contrast(picture: Picture, seed: tf.Tensor) -> Picture:
    """Stretch every channel about its mean."""
    return _shown(picture, tf.image.adjust_contrast(picture["image"], draw(seed, *CONTRAST)))


def hue(picture: Picture, seed: tf.Tensor) -> Picture:
    """Turn the colour wheel."""
    return _shown(picture, 255 * tf.image.adjust_hue(picture["image"] / 255, draw(seed, *HUE)))


def saturation(picture: Picture, seed: tf.Tensor) -> Picture:
    """Make colours paler or stronger."""
    factor = draw(seed, *SATURATION)
    return _shown(picture, 255 * tf.image.adjust_saturation(picture["image"] / 255, factor))


def flip(picture: Picture, seed: tf.Tensor) -> Picture:
    """Mirror half of the pictures left to right; turned upside down they come by quarter turns."""
    width = float(picture["image"].shape[1])
    mirror = np.array([[-1, 0, width], [0, 1, 0], [0, 0, 1]], np.float32)

    def mirrored() -> Picture:
        return _moved(picture, lambda field: tf.reverse(field, [1]), tf.constant(mirror))

    return tf.cond(draw(seed, 0, 1) < 0.5, mirrored, lambda: dict(picture))


def quarter_turns(picture: Picture, seed: tf.Tensor) -> Picture:
    """Turn by 0, 90, 180 or 270 degrees; a picture that is not square by 0 or 180, which keep its shape."""
    height, width = picture["image"].shape[:2]
    step = 1 if height == width else 2
    quarters = step * tf.cast(draw(seed, 0, 4 // step), tf.int32)
    angle = tf.cast(quarters, tf.float32) * (-math.pi / 2)

    def turned(field: tf.Tensor) -> tf.Tensor:
        planes = field if field.shape.rank == 3 else field[..., None]
        return tf.reshape(tf.image.rot90(planes, quarters), field.shape)

    return _moved(picture, turned, _turn(angle, (height, width), tf.constant(1.0)))


def rotation(picture: Picture, seed: tf.Tensor) -> Picture:
    """Turn by any angle about the middle, shrunk so that the whole picture stays in the frame.

    Nothing is cut off, since a leaf may reach anywhere and the label counts all of it. The corners are filled
    with the median colour along the border: repeated or mirrored paper would show a ruling that is not
    there and double a leaf near the border, whereas a plain ground beyond a straight edge is what scenes
    show where a sheet ends, and how photos of other shapes are fitted into a network's input.
    """
    size = picture["image"].shape[0], picture["image"].shape[1]
    angle = draw(seed, -math.pi, math.pi)
    cosine, sine = tf.abs(tf.cos(angle)), tf.abs(tf.sin(angle))
    height, width = size
    shrink = tf.minimum(width / (width * cosine + height * sine), height / (width * sine + height * cosine))
    matrix = _turn(angle, size, shrink)

    def turned(field: tf.Tensor) -> tf.Tensor:
        if field.shape.rank == 2:
            warped = _warped(tf.cast(field, tf.float32)[..., None], matrix)[..., 0]
            return tf.cast(warped + 0.5, field.dtype)
        ground = _border_median(field)
        return ground + _warped(field - ground, matrix)

    return _moved(picture, turned, matrix)


def gaussian_noise(picture: Picture, seed: tf.Tensor) -> Picture:
    """Noise of equal strength everywhere, as from a sensor's electronics."""
    strength, field = tf.unstack(tf.random.split(seed, 2))
    normal = tf.random.stateless_normal(picture["image"].shape, field)
    return _shown(picture, picture["image"] + draw(strength, *GAUSSIAN) * normal)


def poisson_noise(picture: Picture, seed: tf.Tensor) -> Picture:
    """Counted photons: noise that grows with the root of the light, as in a dim room."""
    strength, field = tf.unstack(tf.random.split(seed, 2))
    photons = tf.exp(draw(strength, math.log(PHOTONS[0]), math.log(PHOTONS[1])))
    image = picture["image"]
    counted = tf.random.stateless_poisson(image.shape, field, image * photons, tf.float32)
    return _shown(picture, counted / photons)


AUGMENTATIONS: dict[str, Augmentation] = {
    "brightness": brightness,
    "contrast": contrast,
    "hue": hue,
    "saturation": saturation,
    "flip": flip,
    "rotation90": quarter_turns,
    "rotation": rotation,
    "gaussian": gaussian_noise,
    "poisson": poisson_noise,
}
"""In the order in which they are applied: light, then the camera's pose, then its sensor."""


PAPER = ("brightness", "contrast", "hue", "saturation", "flip", "rotation90", "poisson")
"""Those of the paper's best model."""


def augmentations(text: str) -> tuple[str, ...]:
    """What `text` names: "all", "paper", or augmentations separated by commas. Raises InputError."""
    if text in ("all", "paper"):
        return tuple(AUGMENTATIONS) if text == "all" else PAPER
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    switches(names)
    return names


def switches(names: Iterable[str]) -> np.ndarray:
    """bool [9], True for each of `names`, as `augment` takes them. Raises InputError for an unknown name."""
    wanted = list(names)
    for name in wanted:
        if name not in AUGMENTATIONS:
            raise InputError(f"unknown augmentation {name!r}; choose from {', '.join(AUGMENTATIONS)}")
    return np.array([name in wanted for name in AUGMENTATIONS])


def augment(picture: Picture, seed: tf.Tensor, enabled: tf.Tensor) -> Picture:
    """Apply the augmentations that are `enabled`, bool [9] as `switches` gives it, to one picture.

    `image` is uint8 [H, W, 3] here, in and out. `enabled` may be a variable: which augmentations run is
    decided for every picture anew, so that one traced pipeline serves any set of them; one that is off costs
    a branch.
    """
    seeds = tf.unstack(tf.random.split(seed, len(AUGMENTATIONS)))
    image = picture["image"]
    picture = picture | {"image": tf.cast(image, tf.float32)}
    for row, change in enumerate(AUGMENTATIONS.values()):
        picture = tf.cond(
            enabled[row],
            lambda picture=picture, change=change, seed=seeds[row]: change(picture, seed),
            lambda picture=picture: dict(picture),
        )
    return picture | {"image": tf.cast(picture["image"] + 0.5, image.dtype)}


def _shown(picture: Picture, image: tf.Tensor) -> Picture:
    return picture | {"image": tf.clip_by_value(image, 0, 255)}


def _moved(picture: Picture, move: Callable[[tf.Tensor], tf.Tensor], matrix: tf.Tensor) -> Picture:
    """`picture` with its fields through `move`, which takes pixels to `matrix` [3, 3] times them."""
    moved = picture | {name: move(picture[name]) for name in ("image", "mask") if name in picture}
    if "px_per_mm" in picture:
        moved["px_per_mm"] = picture["px_per_mm"] * tf.sqrt(tf.abs(tf.linalg.det(matrix)))
    if "to_px" in picture:
        moved["to_px"] = matrix @ picture["to_px"]
    return moved


def _turn(angle: tf.Tensor, size: tuple[int, int], zoom: tf.Tensor) -> tf.Tensor:
    """Matrix [3, 3] that turns pixels, their centres at halves, by `angle` about the middle and zooms."""
    middle = np.array([size[1] / 2, size[0] / 2], np.float32)
    cosine, sine = zoom * tf.cos(angle), zoom * tf.sin(angle)
    linear = tf.stack([tf.stack([cosine, -sine]), tf.stack([sine, cosine])])
    shift = middle - tf.linalg.matvec(linear, tf.constant(middle))
    return tf.concat([tf.concat([linear, shift[:, None]], axis=1), [[0.0, 0.0, 1.0]]], axis=0)


def _warped(field: tf.Tensor, matrix: tf.Tensor) -> tf.Tensor:
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
