"""Place the camera: the homography from sheet millimetres to pixels.

Sheet coordinates are millimetres with the centre of the leaf's bounding box at the origin. A homography is
[3, 3] and maps (X, Y, 1) mm to pixels (x right, y down); pixel (i, j) covers [j, j+1] x [i, i+1].
"""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.geometry import ImageSize, project_points, px_per_mm_at


class CameraView(NamedTuple):
    """One camera position: `to_px` maps sheet mm to pixels, `px_per_mm` is the scale at the centroid."""

    to_px: tf.Tensor
    px_per_mm: tf.Tensor
    fov_mm: tf.Tensor


IMAGE_BORDER = 0.02
"""The leaf keeps this fraction of the picture's side between itself and the frame."""


def compute_view(camera: CameraParams, outline: tf.Tensor, size: ImageSize | tf.Tensor) -> CameraView:
    """Point the camera at the leaf `outline` [n, 2] (sheet mm, centred) so that it lies in the frame."""
    height, width = tf.unstack(tf.cast(size, tf.float32))
    extent = tf.reduce_max(outline, axis=0) - tf.reduce_min(outline, axis=0)
    fov = tf.clip_by_value(tf.reduce_max(extent) / camera.fill, camera.closest_mm, camera.farthest_mm)
    tilt = camera.tilt_deg * tf.cast(camera.tilted, tf.float32) * (math.pi / 180)
    homography = pinhole_homography(tilt, camera.tilt_direction, camera.roll, camera.focal * fov, width / fov)
    box = project_points(homography, outline)
    corner, box_size = tf.reduce_min(box, axis=0), tf.reduce_max(box, axis=0) - tf.reduce_min(box, axis=0)
    frame = tf.stack([width, height])
    room = frame - 2 * IMAGE_BORDER * frame
    zoom = tf.minimum(tf.reduce_min(room / box_size), 1)
    place = tf.stack([camera.place_x, camera.place_y])
    shift = IMAGE_BORDER * frame + place * (room - zoom * box_size) - zoom * corner
    to_px = tf.linalg.matmul(_scale_and_shift(zoom, shift), homography)
    return CameraView(
        to_px=to_px, px_per_mm=px_per_mm_at(to_px, tf.reduce_mean(outline, axis=0)), fov_mm=fov / zoom
    )


def pinhole_homography(
    tilt: tf.Tensor, direction: tf.Tensor, roll: tf.Tensor, distance: tf.Tensor, scale: tf.Tensor
) -> tf.Tensor:
    """Homography of a pinhole `distance` mm above the origin, tilted about the axis at `direction`."""
    foreshorten = (
        tf.eye(3) + (tf.cos(tilt) - 1) * _unit_matrix(1, 1) + tf.sin(tilt) / distance * _unit_matrix(2, 1)
    )
    tilted = _rotation_homography(direction + roll) @ foreshorten @ _rotation_homography(-direction)
    return tf.stack([scale, scale, 1.0])[:, None] * tilted


def _rotation_homography(angle: tf.Tensor) -> tf.Tensor:
    in_plane = _unit_matrix(0, 0) + _unit_matrix(1, 1)
    return (
        _unit_matrix(2, 2)
        + tf.cos(angle) * in_plane
        + tf.sin(angle) * (_unit_matrix(1, 0) - _unit_matrix(0, 1))
    )


def _scale_and_shift(zoom: tf.Tensor, shift: tf.Tensor) -> tf.Tensor:
    """Homography of scaling by `zoom` and shifting by `shift` [2] pixels."""
    move = tf.concat([shift, [1.0]], axis=0)[:, None] * np.array([0, 0, 1], np.float32)
    return zoom * (_unit_matrix(0, 0) + _unit_matrix(1, 1)) + move


def _unit_matrix(row: int, column: int) -> np.ndarray:
    """The 3 x 3 matrix that is 1 at one place and 0 elsewhere."""
    matrix = np.zeros((3, 3), np.float32)
    matrix[row, column] = 1
    return matrix
