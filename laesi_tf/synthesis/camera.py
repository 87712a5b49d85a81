"""The camera: where a millimetre of the sheet lands in the picture, and what lens and sensor do to it.

Sheet coordinates are millimetres with the leaf's centre at the origin; pixel coordinates are (x right, y
down), pixel (i, j) covering [j, j+1] x [i, i+1]. A homography is [3, 3] and maps (X, Y, 1) mm to pixels.
Images are planar here: [3, H, W] in [0, 1], which on a CPU is several times faster than channels last.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.frame import Size
from laesi_tf.synthesis.fusing import fused
from laesi_tf.synthesis.ranges import Chance, Number


@dataclass(frozen=True)
class Camera:
    """A phone held over the sheet."""

    fill: Number = (0.25, 0.86)
    """Longer side of the leaf's bounding box over the picture's side, before the limits of the view."""
    closest_mm: Number = 70
    farthest_mm: Number = 230
    """Limits of the field of view: width of the sheet seen at the leaf."""
    tilted: Number = Chance(0.6)
    tilt_deg: Number = (0, 20)
    tilt_direction: Number = (-math.pi, math.pi)
    roll: Number = (-math.pi, math.pi)
    focal: Number = (0.9, 1.6)
    """Focal length in picture widths."""
    place_x: Number = (0.0, 1.0)
    place_y: Number = (0.0, 1.0)
    """Where the leaf's bounding box lies in the frame: 0 at one border, 1 at the other."""
    blurred: Number = Chance(0.5)
    blur_mm: Number = (0.03, 0.25)
    """Spread of the focus blur, mm on the sheet: that of a Gaussian whose tails are cut off where that of the
    widest is at 1.25 of its standard deviations."""
    noise: Number = (0.0, 0.025)
    """Standard deviation: 1.25 times this in the shadows, half of that in the lights. A photo that is shrunk
    keeps little."""
    warmth: Number = (-0.2, 0.2)
    """White balance: gain of red against blue."""
    green: Number = (-0.06, 0.06)
    exposure: Number = (0.65, 1.06)
    """Where the exposure meter puts the brightest channel of bare paper: phones seldom bleach what fills the
    frame."""
    contrast: Number = (0.85, 1.2)
    saturation: Number = (0.75, 1.3)
    compressed: Number = Chance(0.35)
    """JPEG halves the resolution of colour."""


class View(NamedTuple):
    """One camera position: `to_px` maps sheet mm to pixels, `px_per_mm` is the scale at the centroid."""

    to_px: tf.Tensor
    px_per_mm: tf.Tensor
    fov_mm: tf.Tensor


_WIDEST_BLUR_MM = 0.25
"""Taps of the blur are laid out for this much; a wider one is cut off."""
_LUMA = (0.299, 0.587, 0.114)
MARGIN = 0.02
"""The leaf keeps this fraction of the picture's side between itself and the frame."""


def view(camera: Camera, outline: tf.Tensor, size: Size | tf.Tensor) -> View:
    """Point the camera at the leaf `outline` [n, 2] (sheet mm, centred) so that it lies in the frame."""
    height, width = tf.unstack(tf.cast(size, tf.float32))
    extent = tf.reduce_max(outline, axis=0) - tf.reduce_min(outline, axis=0)
    fov = tf.clip_by_value(tf.reduce_max(extent) / camera.fill, camera.closest_mm, camera.farthest_mm)
    tilt = camera.tilt_deg * tf.cast(camera.tilted, tf.float32) * (math.pi / 180)
    homography = _pinhole(tilt, camera.tilt_direction, camera.roll, camera.focal * fov, width / fov)
    box = project(homography, outline)
    corner, box_size = tf.reduce_min(box, axis=0), tf.reduce_max(box, axis=0) - tf.reduce_min(box, axis=0)
    frame = tf.stack([width, height])
    room = frame - 2 * MARGIN * frame
    zoom = tf.minimum(tf.reduce_min(room / box_size), 1)
    place = tf.stack([camera.place_x, camera.place_y])
    shift = MARGIN * frame + place * (room - zoom * box_size) - zoom * corner
    to_px = tf.linalg.matmul(_crop(zoom, shift), homography)
    return View(to_px=to_px, px_per_mm=scale_at(to_px, tf.reduce_mean(outline, axis=0)), fov_mm=fov / zoom)


def _pinhole(
    tilt: tf.Tensor, direction: tf.Tensor, roll: tf.Tensor, distance: tf.Tensor, scale: tf.Tensor
) -> tf.Tensor:
    """Homography of a pinhole `distance` mm above the origin, tilted about the axis at `direction`."""
    foreshorten = tf.eye(3) + (tf.cos(tilt) - 1) * _unit(1, 1) + tf.sin(tilt) / distance * _unit(2, 1)
    tilted = _rotation(direction + roll) @ foreshorten @ _rotation(-direction)
    return tf.stack([scale, scale, 1.0])[:, None] * tilted


def _rotation(angle: tf.Tensor) -> tf.Tensor:
    in_plane = _unit(0, 0) + _unit(1, 1)
    return _unit(2, 2) + tf.cos(angle) * in_plane + tf.sin(angle) * (_unit(1, 0) - _unit(0, 1))


def _crop(zoom: tf.Tensor, shift: tf.Tensor) -> tf.Tensor:
    """Homography of scaling by `zoom` and shifting by `shift` [2] pixels."""
    move = tf.concat([shift, [1.0]], axis=0)[:, None] * np.array([0, 0, 1], np.float32)
    return zoom * (_unit(0, 0) + _unit(1, 1)) + move


def _unit(row: int, column: int) -> np.ndarray:
    """The 3 x 3 matrix that is 1 at one place and 0 elsewhere."""
    matrix = np.zeros((3, 3), np.float32)
    matrix[row, column] = 1
    return matrix


def project(homography: tf.Tensor, points: tf.Tensor) -> tf.Tensor:
    """Map `points` [..., 2] through `homography` [3, 3]."""
    flat = tf.reshape(points, [-1, 2])
    mapped = tf.linalg.matmul(flat, homography[:, :2], transpose_b=True) + homography[:, 2]
    return tf.reshape(mapped[:, :2] / mapped[:, 2:], tf.shape(points))


def scale_at(homography: tf.Tensor, point: tf.Tensor) -> tf.Tensor:
    """Pixels per millimetre at `point` [2] mm: root of the Jacobian determinant, |det H| / w^3."""
    w = tf.reduce_sum(homography[2, :2] * point) + homography[2, 2]
    determinant = tf.reduce_sum(homography[0] * tf.linalg.cross(homography[1], homography[2]))
    return tf.sqrt(tf.abs(determinant) / tf.abs(w) ** 3)


def sheet_coordinates(to_px: tf.Tensor, size: Size) -> tuple[tf.Tensor, tf.Tensor]:
    """Sheet position X, Y [H, W] in mm under each pixel's centre."""
    # The adjugate: a homography's inverse up to a factor, which the division removes.
    inverse = tf.linalg.cross(tf.gather(to_px, [1, 2, 0]), tf.gather(to_px, [2, 0, 1]))
    u = tf.range(size[1], dtype=tf.float32)[None, :] + 0.5
    v = tf.range(size[0], dtype=tf.float32)[:, None] + 0.5
    x, y, w = (u * column[0] + (v * column[1] + column[2]) for column in tf.unstack(inverse, axis=1))
    reciprocal = 1 / w
    return x * reciprocal, y * reciprocal


@fused
def blur(image: tf.Tensor, sigma: tf.Tensor, reach: int) -> tf.Tensor:
    """Gaussian blur of [..., H, W] by `sigma` pixels, with 2 * `reach` + 1 taps on each axis."""
    taps = tf.exp(-0.5 * (tf.range(reach + 1, dtype=tf.float32) / tf.maximum(sigma, 1e-3)) ** 2)
    taps = tf.unstack(taps / (2 * tf.reduce_sum(taps) - 1))
    return _convolve(_convolve(image, taps, axis=-1), taps, axis=-2)


def _convolve(image: tf.Tensor, taps: list[tf.Tensor], axis: int) -> tf.Tensor:
    reach = len(taps) - 1
    length = image.shape[axis]
    first, last = (tf.repeat(tf.gather(image, [end], axis=axis), reach, axis=axis) for end in (0, length - 1))
    # Repeating the border by hand: tf.pad's mirror modes cost more than the convolution.
    padded = tf.concat([first, image, last], axis=axis)

    def shifted(offset: int) -> tf.Tensor:
        window = [slice(None)] * image.shape.rank
        window[axis] = slice(reach + offset, reach + offset + length)
        return padded[tuple(window)]

    result = shifted(0) * taps[0]
    for offset in range(1, reach + 1):
        result += (shifted(offset) + shifted(-offset)) * taps[offset]
    return result


def focus(image: tf.Tensor, camera: Camera, px_per_mm: tf.Tensor) -> tf.Tensor:
    """Focus blur of [3, H, W] where the scene has it."""
    reach = math.ceil(1.25 * _WIDEST_BLUR_MM * max(image.shape[1:]) / 70)
    return tf.cond(camera.blurred, lambda: blur(image, camera.blur_mm * px_per_mm, reach), lambda: image)


def halved_chroma(image: tf.Tensor) -> tf.Tensor:
    """Means [3, ceil(H / 2), ceil(W / 2)] of colour less luma over blocks of two by two pixels."""
    _, height, width = image.shape
    last = tf.concat([image, image[:, -1:]], axis=1) if height % 2 else image
    even = tf.concat([last, last[:, :, -1:]], axis=2) if width % 2 else last
    corners = [even[:, row::2, column::2] for row in (0, 1) for column in (0, 1)]
    mean = (corners[0] + corners[1] + corners[2] + corners[3]) / 4
    return mean - _luma(mean)


def with_chroma(image: tf.Tensor, chroma: tf.Tensor) -> tf.Tensor:
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
    return _luma(image) + chroma[:, : image.shape[1], : image.shape[2]]


def develop(image: tf.Tensor, camera: Camera, paper: tf.Tensor) -> tf.Tensor:
    """White balance, exposure, contrast and saturation of [3, H, W]: one affine map of colour.

    The exposure is metered on the bare `paper`, its colour [3, 1, 1].
    """
    balance = tf.stack([1 + camera.warmth / 2, 1 + camera.green, 1 - camera.warmth / 2])
    gains = balance * (camera.exposure / tf.reduce_max(balance * paper[:, 0, 0]))
    mix = camera.saturation * tf.eye(3) + (1 - camera.saturation) * tf.constant([_LUMA] * 3)
    matrix = camera.contrast * mix * gains[None, :]
    mixed = sum(matrix[:, channel, None, None] * image[channel] for channel in range(3))
    return mixed + 0.5 * (1 - camera.contrast)


def sensor_noise(image: tf.Tensor, camera: Camera, grain: tf.Tensor) -> tf.Tensor:
    """Sensor noise on [3, H, W], stronger in the shadows as a tone curve makes it.

    `grain` [3, H, W] has unit variance.
    """
    return image + camera.noise * (1.25 - 0.6 * image[1]) * grain


def _luma(image: tf.Tensor) -> tf.Tensor:
    return _LUMA[0] * image[:1] + _LUMA[1] * image[1:2] + _LUMA[2] * image[2:]
