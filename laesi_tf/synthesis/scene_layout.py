"""Where everything in a scene is: the leaf on the sheet, the camera's view of it, edges in pixels."""

import math
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import rasterizer
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.camera.view import CameraView, compute_view
from laesi_tf.synthesis.geometry import ImageSize, project_points
from laesi_tf.synthesis.kernels import Components
from laesi_tf.synthesis.leaf import veins
from laesi_tf.synthesis.leaf.holes import hole_outlines, sample_hole_numbers
from laesi_tf.synthesis.leaf.outline import (
    OutlineCurve,
    leaf_area_cm2,
    resample_outline,
    sample_outline_curve,
)
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.leaf.surface import SurfaceParams
from laesi_tf.synthesis.polygons import polygon_edges, subdivide_edges, subdivide_polygon
from laesi_tf.synthesis.scene import Scene
from laesi_tf.synthesis.xla import compile_with_xla


class LeafPose(NamedTuple):
    """Rotation [2, 2] and translation [2] from leaf coordinates to sheet coordinates, mm."""

    turn: tf.Tensor
    shift: tf.Tensor

    def apply(self, points: tf.Tensor) -> tf.Tensor:
        """Leaf coordinates [..., 2] to sheet coordinates [..., 2]."""
        flat = tf.linalg.matmul(tf.reshape(points, [-1, 2]), self.turn, transpose_b=True) + self.shift
        return tf.reshape(flat, tf.shape(points))


class SceneLayout(NamedTuple):
    """Where everything is: the leaf's `outline` [n, 2] and `holes` [k, m, 2] in sheet mm, with the leaf's box
    centred on the origin, and the camera's view of them."""

    outline: tf.Tensor
    holes: tf.Tensor
    pose: LeafPose
    view: CameraView
    area_cm2: tf.Tensor


def compute_layout(scene: Scene, size: ImageSize) -> SceneLayout:
    """Lay the leaf on the sheet and point the camera at it."""
    ring, places = sample_outline_curve(scene.leaf, scene.key), sample_hole_numbers(scene.key)
    # The size as a tensor: one compilation serves all sizes, and the label is the same at each.
    return _compute_layout(scene.leaf, scene.camera, ring, places, tf.constant(size, tf.float32))


@compile_with_xla
def _compute_layout(
    leaf: LeafParams, held: CameraParams, ring: OutlineCurve, places: tf.Tensor, size: tf.Tensor
) -> SceneLayout:
    """`geometry` of a leaf whose outline is `ring` and whose holes are at `places`."""
    outline, holes = resample_outline(ring), hole_outlines(leaf, places)
    cosine, sine = tf.cos(leaf.angle), tf.sin(leaf.angle)
    turn = tf.stack([tf.stack([cosine, -sine]), tf.stack([sine, cosine])])
    turned = tf.linalg.matmul(outline, turn, transpose_b=True)
    pose = LeafPose(turn, -(tf.reduce_min(turned, axis=0) + tf.reduce_max(turned, axis=0)) / 2)
    centred = turned + pose.shift
    return SceneLayout(
        outline=centred,
        holes=pose.apply(holes),
        pose=pose,
        view=compute_view(held, centred, size),
        area_cm2=leaf_area_cm2(outline, holes),
    )


def leaf_edges(place: SceneLayout, size: ImageSize) -> tf.Tensor:
    """Edges [n, 2 ends, 2] of the leaf and its holes in pixels."""
    pieces = math.ceil(max(size) / 256)
    polygons = [
        subdivide_polygon(project_points(place.view.to_px, points), pieces)
        for points in (place.outline, place.holes)
    ]
    return tf.concat([tf.reshape(polygon_edges(points), [-1, 2, 2]) for points in polygons], axis=0)


def _vein_edges(
    place: SceneLayout, leaf: LeafParams, skin: SurfaceParams, commands: tf.Tensor, size: ImageSize
) -> tf.Tensor:
    """Edges [n, 2 ends, 2] of the leaf's veins in pixels."""
    edges = veins.vein_edges(leaf, commands, skin.vein_jitter, skin.vein_width_mm)
    return subdivide_edges(
        project_points(place.view.to_px, place.pose.apply(edges)), math.ceil(max(size) / 40)
    )


@compile_with_xla
def leaf_edge_contributions(
    place: SceneLayout,
    leaf: LeafParams,
    skin: SurfaceParams,
    commands: tf.Tensor,
    size: ImageSize,
    parts: Components,
) -> list[rasterizer.EdgeContributions]:
    """What the edges of the leaf leave in the picture's cells, and what those of its veins do."""
    edges = [leaf_edges(place, size)]
    if "veins" in parts:
        edges.append(_vein_edges(place, leaf, skin, commands, size))
    return [rasterizer.edge_contributions(polygons, size) for polygons in edges]
