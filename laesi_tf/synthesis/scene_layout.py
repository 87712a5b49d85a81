"""Where everything in a scene is: the leaf on the sheet, the camera's view of it, and edges in pixels."""

import dataclasses
import math
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.camera.view import CameraView, compute_view
from laesi_tf.synthesis.geometry import (
    ImageSize,
    interpolate_at,
    polygon_edges,
    subdivide_edges,
    subdivide_polygon,
)
from laesi_tf.synthesis.leaf.holes import hole_outlines
from laesi_tf.synthesis.leaf.mesh import leaf_area_cm2
from laesi_tf.synthesis.leaf.outline import OutlineCurve
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.leaf.surface import SurfaceParams
from laesi_tf.synthesis.leaf.veins import petiole_edges, vein_edges
from laesi_tf.synthesis.ranges import Scalar
from laesi_tf.synthesis.rasterizer import EdgeContributions, edge_contributions

WHOLE_LEAF_MM = 30.0
"""Width of the closest view that shows a whole leaf."""
_EMPTY_VIEW = 0.35
"""Width of the view of an empty sheet over that of a leaf."""


class LeafPose(NamedTuple):
    """Rotation [2, 2], scaled for a leaf above its sheet, and translation [2] from leaf coordinates to sheet
    coordinates, mm."""

    rotation: tf.Tensor
    translation: tf.Tensor

    def apply(self, points: tf.Tensor) -> tf.Tensor:
        """Map leaf coordinates [..., 2] to sheet coordinates [..., 2]."""
        flat = tf.reshape(points, [-1, 2])
        moved = tf.linalg.matmul(flat, self.rotation, transpose_b=True) + self.translation
        return tf.reshape(moved, tf.shape(points))

    def magnify(self, factor: tf.Tensor, centre: tf.Tensor) -> "LeafPose":
        """Return the pose behind which all sheet points are `factor` times as far from `centre` [2]."""
        return LeafPose(factor * self.rotation, centre + factor * (self.translation - centre))


class SceneLayout(NamedTuple):
    """The leaf on the sheet and the camera's view of it.

    `outline` [n, 2] and `holes` [k, m, 2] are what the leaf, as the camera sees it, covers of the sheet, in
    mm; the centre of its own bounding box is the origin. `area_cm2` [] is the label, the leaf's own area.
    """

    outline: tf.Tensor
    holes: tf.Tensor
    pose: LeafPose
    view: CameraView
    area_cm2: tf.Tensor

    def remove_leaf_if(self, is_empty: tf.Tensor) -> "SceneLayout":
        """Return the layout, with the leaf shrunk to a point, which paints nothing, if `is_empty` [] bool."""
        keep = tf.where(is_empty, 0.0, 1.0)
        pose = LeafPose(keep * self.pose.rotation, keep * self.pose.translation)
        return SceneLayout(keep * self.outline, keep * self.holes, pose, self.view, keep * self.area_cm2)


def shrink_leaf_if(leaf: LeafParams[Scalar], is_empty: tf.Tensor) -> LeafParams[Scalar]:
    """Return `leaf`, shorter if `is_empty` [] bool: the view of an empty sheet often shows smaller things."""
    return dataclasses.replace(leaf, length_mm=leaf.length_mm * tf.where(is_empty, _EMPTY_VIEW, 1.0))


def compute_layout(
    leaf: LeafParams[Scalar],
    camera: CameraParams[Scalar],
    curve: OutlineCurve,
    hole_numbers: tf.Tensor,
    size: tf.Tensor,
    components: tuple[str, ...],
) -> SceneLayout:
    """Place the leaf on the sheet and point the camera at it.

    `hole_numbers` [k, 8] are uniform in [0, 1), `size` [2] is the image's height and width in pixels. Any
    `components` bend the straight lines of the view.
    """
    outline, holes = interpolate_at(*curve), hole_outlines(leaf, hole_numbers)
    cosine, sine = tf.cos(leaf.angle), tf.sin(leaf.angle)
    rotation = tf.stack([tf.stack([cosine, -sine]), tf.stack([sine, cosine])])
    rotated = tf.linalg.matmul(outline, rotation, transpose_b=True)
    pose = LeafPose(rotation, -(tf.reduce_min(rotated, axis=0) + tf.reduce_max(rotated, axis=0)) / 2)
    view = compute_view(camera, rotated + pose.translation, size, is_distorted=bool(components))
    lifted = pose.magnify(view.magnification_at(leaf.lift_mm), view.foot)
    return SceneLayout(
        outline=lifted.apply(outline),
        holes=lifted.apply(holes),
        pose=lifted,
        view=view,
        area_cm2=leaf_area_cm2(outline, holes),
    )


def leaf_contributions(
    layout: SceneLayout,
    leaf: LeafParams[Scalar],
    surface: SurfaceParams[Scalar],
    turtle_noise: tf.Tensor,
    size: ImageSize,
    components: tuple[str, ...],
    closest_mm: float,
) -> tuple[EdgeContributions, EdgeContributions | None]:
    """Return what the edges of the leaf, and those of its veins, contribute to the image's cells.

    `turtle_noise` are the normal numbers of `vein_edges`, `closest_mm` is the width of the closest view. The
    second is None without veins.
    """
    of_outline = edge_contributions(leaf_edges(layout, size, closest_mm), size)
    if "veins" not in components:
        return of_outline, None
    outlines = vein_edges(leaf, turtle_noise, surface.vein_jitter, surface.vein_width_mm)
    if "red_petiole" in components:
        outlines = tf.concat([outlines, petiole_edges(leaf, surface.petiole_red)], axis=0)
    projected = layout.view.to_photo(layout.pose.apply(outlines))
    pieces = math.ceil(max(size) / 40 * _magnification(closest_mm))
    return of_outline, edge_contributions(subdivide_edges(projected, pieces), size)


def leaf_edges(layout: SceneLayout, size: ImageSize, closest_mm: float = WHOLE_LEAF_MM) -> tf.Tensor:
    """Return the edges [n, 2 ends, 2] of the leaf and its holes in pixels.

    `closest_mm` is the width of the closest view, which shows a part of the leaf only if it is below that of
    whole leaves.
    """
    pieces = math.ceil(max(size) / 256 * _magnification(closest_mm))
    loops = [
        subdivide_polygon(layout.view.to_photo(points), pieces) for points in (layout.outline, layout.holes)
    ]
    return tf.concat([tf.reshape(polygon_edges(points), [-1, 2, 2]) for points in loops], axis=0)


def _magnification(closest_mm: float) -> float:
    """Return how much closer a view may be than those of whole leaves, at least 1."""
    return max(1.0, WHOLE_LEAF_MM / closest_mm)
