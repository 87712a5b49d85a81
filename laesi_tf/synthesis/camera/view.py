"""Place the camera: the map from sheet mm to pixels.

Sheet coordinates are mm with the centre of the leaf's bounding box at the origin; conventions as in
`laesi_tf.synthesis.geometry`.
"""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.camera.distortion import Distortion, inner_rectangle, make_distortion
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.geometry import (
    ImageSize,
    determinant,
    invert_homography,
    pixel_centres_to_sheet,
    polygon_centroid,
    project_points,
    px_per_mm_at,
)
from laesi_tf.synthesis.ranges import Scalar

IMAGE_BORDER = 0.02
"""Fraction of the image's side that the leaf stays away from the image border."""


class CameraView(NamedTuple):
    """One camera position.

    `to_px` [3, 3] maps sheet mm to pixels, `px_per_mm` is the scale at the leaf's area centroid, `fov_mm` the
    width of the sheet that the image shows at the leaf. The camera is `height_mm` above `foot` [2], a sheet
    point in mm. With a `distortion`, which ranges without lens and
    bend lack, `to_px` is the homography of the same photo without them.
    """

    to_px: tf.Tensor
    px_per_mm: tf.Tensor
    fov_mm: tf.Tensor
    foot: tf.Tensor
    height_mm: tf.Tensor
    distortion: Distortion | None = None

    def to_photo(self, points: tf.Tensor) -> tf.Tensor:
        """Return the photo points [..., 2] in pixels of sheet `points` [..., 2] in mm."""
        flat = project_points(self.to_px, points)
        return flat if self.distortion is None else self.distortion.from_flat(flat)

    def to_sheet(self, points: tf.Tensor) -> tf.Tensor:
        """Return the sheet points [..., 2] in mm of photo `points` [..., 2] in pixels."""
        flat = points if self.distortion is None else self.distortion.to_flat(points)
        return project_points(invert_homography(self.to_px), flat)

    def magnification_at(self, height_mm: tf.Tensor) -> tf.Tensor:
        """Return by what factor, about `foot`, a thing so high above the flat sheet covers more of it."""
        return self.height_mm / (self.height_mm - height_mm)

    def pixel_centres_to_sheet(self, size: ImageSize) -> tuple[tf.Tensor, tf.Tensor]:
        """Return the sheet positions X and Y, [H, W] mm, of all pixel centres of the photo."""
        if self.distortion is not None:
            return self.distortion.pixel_centres_to_sheet(size)
        return pixel_centres_to_sheet(self.to_px, size)

    def mm2_per_px(self, points: tf.Tensor) -> tf.Tensor:
        """Return the square millimetres of the sheet under a pixel, [...], at photo `points` [..., 2]."""
        sheet = self.to_sheet(points)
        w = tf.reduce_sum(sheet * self.to_px[2, :2], axis=-1) + self.to_px[2, 2]
        of_flat = tf.abs(w) ** 3 / tf.abs(determinant(self.to_px))
        return of_flat if self.distortion is None else of_flat * self.distortion.area_ratio(points)


def compute_view(
    camera: CameraParams[Scalar],
    outline: tf.Tensor,
    size: ImageSize | tf.Tensor,
    *,
    is_distorted: bool = False,
) -> CameraView:
    """Point the camera at the leaf `outline` [n, 2] (sheet mm, centred) so that the image holds all of it.

    `size` is (height, width) in pixels; `is_distorted` adds lens and bend.
    """
    height, width = tf.unstack(tf.cast(size, tf.float32))
    extent = tf.reduce_max(outline, axis=0) - tf.reduce_min(outline, axis=0)
    fov = tf.clip_by_value(tf.reduce_max(extent) / camera.fill, camera.closest_mm, camera.farthest_mm)
    tilt, distance = tilt_deg(camera) * (math.pi / 180), camera.focal * fov
    homography = pinhole_homography(tilt, camera.tilt_direction, camera.roll, distance, width / fov)
    box = project_points(homography, outline)
    corner, box_size = tf.reduce_min(box, axis=0), tf.reduce_max(box, axis=0) - tf.reduce_min(box, axis=0)
    image_wh = tf.stack([width, height])
    low, free_space = IMAGE_BORDER * image_wh, image_wh - 2 * IMAGE_BORDER * image_wh
    if is_distorted:
        # The tilt that displaces bent paper is that of the placed camera, which differs a little.
        centring = place_matrix(1.0, image_wh / 2)
        rough = make_distortion(camera, tf.linalg.matmul(centring, homography), height, width)
        low, high = inner_rectangle(rough, low, low + free_space)
        free_space = high - low
    zoom = tf.minimum(tf.reduce_min(free_space / box_size), 1)
    position = tf.stack([camera.place_x, camera.place_y])
    shift = low + position * (free_space - zoom * box_size) - zoom * corner
    to_px = tf.linalg.matmul(place_matrix(zoom, shift), homography)
    centroid = polygon_centroid(outline)
    view = CameraView(
        to_px,
        px_per_mm_at(to_px, centroid),
        fov_mm=fov / zoom,
        foot=_camera_foot(tilt, camera.tilt_direction, distance),
        height_mm=distance * tf.cos(tilt),
    )
    if not is_distorted:
        return view
    view = view._replace(distortion=make_distortion(camera, to_px, height, width))
    return view._replace(px_per_mm=tf.math.rsqrt(view.mm2_per_px(view.to_photo(centroid))))


def place_matrix(zoom: tf.Tensor | float, shift: tf.Tensor) -> tf.Tensor:
    """Return the matrix [3, 3] that scales by `zoom`, then shifts by `shift` [2], both in pixels."""
    move = tf.concat([shift, [1.0]], axis=0)[:, None] * np.array([0, 0, 1], np.float32)
    return zoom * (_unit_matrix(0, 0) + _unit_matrix(1, 1)) + move


def tilt_deg(camera: CameraParams[Scalar]) -> tf.Tensor:
    """Return the angle in degrees between the optical axis and the sheet's normal."""
    return camera.tilt_deg * tf.cast(camera.tilted, tf.float32)


def pinhole_homography(
    tilt: tf.Tensor, direction: tf.Tensor, roll: tf.Tensor, distance: tf.Tensor, scale: tf.Tensor
) -> tf.Tensor:
    """Return the homography [3, 3] of a tilted pinhole camera `distance` mm above the origin.

    The axis of the tilt lies in the sheet. `tilt`, its `direction` and `roll` about the optical axis are
    radians; `scale` is px/mm at the origin.
    """
    foreshortening = (
        tf.eye(3) + (tf.cos(tilt) - 1) * _unit_matrix(1, 1) + tf.sin(tilt) / distance * _unit_matrix(2, 1)
    )
    tilted = _rotation_homography(direction + roll) @ foreshortening @ _rotation_homography(-direction)
    return tf.stack([scale, scale, 1.0])[:, None] * tilted


def _camera_foot(tilt: tf.Tensor, direction: tf.Tensor, distance: tf.Tensor) -> tf.Tensor:
    """Return the sheet point [2] in mm below the camera of `pinhole_homography`."""
    return distance * tf.sin(tilt) * tf.stack([tf.sin(direction), -tf.cos(direction)])


def _rotation_homography(angle: tf.Tensor) -> tf.Tensor:
    in_plane = _unit_matrix(0, 0) + _unit_matrix(1, 1)
    return (
        _unit_matrix(2, 2)
        + tf.cos(angle) * in_plane
        + tf.sin(angle) * (_unit_matrix(1, 0) - _unit_matrix(0, 1))
    )


def _unit_matrix(row: int, column: int) -> np.ndarray:
    """Return the 3 x 3 matrix that is 1 at (row, column) and 0 elsewhere."""
    matrix = np.zeros((3, 3), np.float32)
    matrix[row, column] = 1
    return matrix
