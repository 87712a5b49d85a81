"""What the lens and a bent sheet add to the homography between sheet and photo.

The model, its units and its signs are those of `laesi_tf.common.sheet_model`, which the fit of a photo's
ruling uses: points in half the photo's longer side from its middle, so that k1 has this unit too.
"""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.common.sheet_model import FOCAL_SQUARED, SheetModel, remove_bend, remove_distortion, to_lines
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.geometry import ImageSize, invert_homography
from laesi_tf.synthesis.ranges import Scalar

_BORDER_POINTS = 17
_FARTHEST = 2.0
"""Distance from the middle, beyond every photo's corner, from which the inverse is continued linearly."""
_LENS_STEPS = 4
_BEND_STEPS = 8
"""Steps of the inverse, which converges to 1e-6 within the photo."""


class Distortion(NamedTuple):
    """Radial distortion and bend of one photo: `model` maps photo points to sheet mm.

    `half_side_px` [] is half the photo's longer side, `middle_px` [2] its middle, (x, y).
    """

    model: SheetModel
    half_side_px: tf.Tensor
    middle_px: tf.Tensor

    def pixel_centres_to_sheet(self, size: ImageSize) -> tuple[tf.Tensor, tf.Tensor]:
        """Return the sheet positions X and Y, [H, W] mm, of all pixel centres of the photo."""
        u = tf.range(size[1], dtype=tf.float32)[None, :] + 0.5
        v = tf.range(size[0], dtype=tf.float32)[:, None] + 0.5
        x, y = (u - self.middle_px[0]) / self.half_side_px, (v - self.middle_px[1]) / self.half_side_px
        return to_lines(self.model, x, y)

    def to_flat(self, points: tf.Tensor) -> tf.Tensor:
        """Return where photo `points` [..., 2] would be without lens and bend, both in pixels."""
        x, y = tf.unstack((points - self.middle_px) / self.half_side_px, axis=-1)
        flat = remove_bend(self.model, *remove_distortion(self.model, x, y))
        return tf.stack(flat, axis=-1) * self.half_side_px + self.middle_px

    def from_flat(self, points: tf.Tensor) -> tf.Tensor:
        """Return the photo points of `points` [..., 2] of a picture without lens and bend, in pixels."""
        target = (points - self.middle_px) / self.half_side_px
        place = target
        for _ in range(_BEND_STEPS):
            x, y = tf.unstack(tf.clip_by_value(place, -_FARTHEST, _FARTHEST), axis=-1)
            bend = tf.stack(remove_bend(self.model, x, y), axis=-1) - tf.stack([x, y], axis=-1)
            place += target - place - bend
        return self._distort(place) * self.half_side_px + self.middle_px

    def area_ratio(self, points: tf.Tensor) -> tf.Tensor:
        """Return the flat picture's area over the photo's, [...], at photo `points` [..., 2] in pixels.

        Both maps are a multiple of the identity plus a product of two vectors: det(aI + pq) = a (a + p.q).
        """
        model = self.model
        x, y = tf.unstack((points - self.middle_px) / self.half_side_px, axis=-1)
        stretch = model.k1 * ((x - model.centre_x) ** 2 + (y - model.centre_y) ** 2)
        x, y = remove_distortion(model, x, y)
        rise = model.bend_xx * x * x + model.bend_xy * x * y + model.bend_yy * y * y
        slope_x = 2 * model.bend_xx * x + model.bend_xy * y
        slope_y = 2 * model.bend_yy * y + model.bend_xy * x
        lever = slope_x * (x - FOCAL_SQUARED * model.tilt_x) + slope_y * (y - FOCAL_SQUARED * model.tilt_y)
        return (1 + stretch) * (1 + 3 * stretch) * (1 + rise) * (1 + rise + lever)

    def _distort(self, place: tf.Tensor) -> tf.Tensor:
        """Return the distorted points of undistorted `place` [..., 2]: Newton's method along the radius."""
        centre = tf.stack([self.model.centre_x, self.model.centre_y])
        wanted = tf.norm(place - centre, axis=-1, keepdims=True)
        limit = _FARTHEST * (1 + self.model.k1 * _FARTHEST**2)
        inside = tf.minimum(wanted, limit)
        radius = inside
        for _ in range(_LENS_STEPS):
            square = self.model.k1 * radius * radius
            radius -= (radius * (1 + square) - inside) / (1 + 3 * square)
        return centre + (place - centre) * tf.math.divide_no_nan(radius, inside)


def make_distortion(
    camera: CameraParams[Scalar], to_px: tf.Tensor, height: tf.Tensor, width: tf.Tensor
) -> Distortion:
    """Return the distortion of a photo of `height` x `width` pixels; `to_px` [3, 3] maps flat mm."""
    half_side, middle = tf.maximum(height, width) / 2, tf.stack([width, height]) / 2
    # The homography from normalised points to mm.
    (a, b, c), (d, e, f), (g, h, i) = (
        tf.unstack(row)
        for row in tf.unstack(
            invert_homography(to_px)
            @ tf.stack(
                [
                    tf.stack([half_side, 0.0, middle[0]]),
                    tf.stack([0.0, half_side, middle[1]]),
                    tf.constant([0.0, 0.0, 1.0]),
                ]
            )
        )
    )
    offset_u, offset_v, tilt_x, tilt_y = c / i, f / i, g / i, h / i
    distorted = tf.cast(camera.distorted, tf.float32)
    bend = camera.bend * tf.cast(camera.bent, tf.float32)
    cosine, sine = tf.cos(camera.bend_angle), tf.sin(camera.bend_angle)
    model = SheetModel(
        offset_u=offset_u,
        offset_v=offset_v,
        ux=a / i - offset_u * tilt_x,
        uy=b / i - offset_u * tilt_y,
        vx=d / i - offset_v * tilt_x,
        vy=e / i - offset_v * tilt_y,
        tilt_x=tilt_x,
        tilt_y=tilt_y,
        k1=camera.k1 * distorted,
        centre_x=camera.lens_x,
        centre_y=camera.lens_y,
        bend_xx=bend * cosine * cosine,
        bend_xy=2 * bend * cosine * sine,
        bend_yy=bend * sine * sine,
    )
    return Distortion(model, half_side, middle)


def inner_rectangle(distortion: Distortion, low: tf.Tensor, high: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the corners [2] of a rectangle whose points the photo shows between `low` and `high` [2]."""
    along = tf.linspace(0.0, 1.0, _BORDER_POINTS)[:, None]
    across = low + along * (high - low)
    sides = [
        distortion.to_flat(tf.stack([tf.fill([_BORDER_POINTS], edge[0]), across[:, 1]], axis=-1))[:, 0]
        for edge in (low, high)
    ]
    ends = [
        distortion.to_flat(tf.stack([across[:, 0], tf.fill([_BORDER_POINTS], edge[1])], axis=-1))[:, 1]
        for edge in (low, high)
    ]
    return (
        tf.stack([tf.reduce_max(sides[0]), tf.reduce_max(ends[0])]),
        tf.stack([tf.reduce_min(sides[1]), tf.reduce_min(ends[1])]),
    )
