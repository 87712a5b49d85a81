"""Crops of synthetic photos at any scale, with what can be seen of the ruling in each of their cells.

The ruling network looks at a whole photo at several resolutions; a crop is a part of what it sees at one.
"""

import dataclasses
import math

import tensorflow as tf

from laesi_tf.synthesis import renderer
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.camera.view import CameraView, place_matrix
from laesi_tf.synthesis.geometry import ImageSize, px_per_mm_at
from laesi_tf.synthesis.paper.kinds import place_in_period, printed_lines, spacing_mm
from laesi_tf.synthesis.paper.sheet import find_sheet
from laesi_tf.synthesis.ranges import Scalar
from laesi_tf.synthesis.ruling_labels import label_ruling
from laesi_tf.synthesis.scene import Scene

_PERIOD_PX = (1.3, 37.0)
"""Pixels per period of the finest lines, log-uniform: what the network's bins hold, and somewhat finer."""
_BLUR_PX = (0.15, 2.2)
"""Standard deviation of the blur, log-uniform: photos are sharp or soft in pixels, whatever the scale."""
_CLOSEST_MM = 10.0
"""Width of the closest crop whose curves are smooth; the closest of all, rare ones, show 6 mm."""
CROP_NUMBERS = 4


def render_ruling_crop(
    scene: Scene, size: ImageSize, numbers: tf.Tensor, *, textures: tf.Tensor | None = None
) -> dict[str, tf.Tensor]:
    """Render a crop of `size` from a scene, somewhere in its image and at any scale.

    `numbers` [CROP_NUMBERS] are uniform in [0, 1). Returns what `render_scene` does, for the crop, and
    `ruling` float32 [h, w, 5], the labels of its cells in the order of `RulingLabels`.
    """
    whole = renderer.compute_layout(scene, size)
    period_px = log_uniform(_PERIOD_PX, numbers[0])
    px_per_mm = period_px / spacing_mm(scene.paper)
    view = crop_view(whole.view, size, place=numbers[1:3], px_per_mm=px_per_mm)
    camera = set_blur(scene.camera, log_uniform(_BLUR_PX, numbers[3]) / px_per_mm)
    crop = dataclasses.replace(scene, camera=camera, closest_mm=_CLOSEST_MM)
    sample = renderer.render_scene(crop, size, layout=whole._replace(view=view), textures=textures)
    places = view.pixel_centres_to_sheet(size)
    bare = find_printed_sheet(scene, whole.outline, *places) & (sample["mask"] == 0)
    lines_mm = place_in_period(scene.paper, *places) * printed_lines(scene.paper).period_mm
    labels = label_ruling(sample["image"], bare, scene.printed_periods_mm, lines_mm)
    return sample | {"ruling": tf.stack(labels, -1)}


def find_printed_sheet(scene: Scene, outline: tf.Tensor, x_mm: tf.Tensor, y_mm: tf.Tensor) -> tf.Tensor:
    """Return whether places [H, W] lie on the printed part of the sheet, on which the leaf `outline` lies."""
    if "desk" not in scene.components:
        return tf.ones_like(x_mm, tf.bool)
    edge_mm, border_mm = find_sheet(scene.paper, outline, x_mm, y_mm, scene.components)
    return (edge_mm > border_mm) | ~scene.paper.edged


def log_uniform(limits: tuple[float, float], uniform: tf.Tensor) -> tf.Tensor:
    """Return the number between `limits` whose ln is at `uniform` in [0, 1)."""
    low, high = limits
    return low * tf.exp(uniform * math.log(high / low))


def crop_view(view: CameraView, size: ImageSize, *, place: tf.Tensor, px_per_mm: tf.Tensor) -> CameraView:
    """Return the view of the crop at `place` [2] in [0, 1) of the image, with `px_per_mm` in its middle.

    Within a crop, lens and bend are a homography, which is what the view's without them serves for.
    """
    image_wh = tf.constant(size[::-1], tf.float32)
    middle = place * image_wh
    flat = view._replace(distortion=None)
    zoom = px_per_mm / px_per_mm_at(view.to_px, flat.to_sheet(middle))
    to_crop = place_matrix(zoom, image_wh / 2 - zoom * middle)
    return flat._replace(
        to_px=to_crop @ view.to_px, px_per_mm=zoom * view.px_per_mm, fov_mm=view.fov_mm / zoom
    )


def set_blur(camera: CameraParams[Scalar], blur_mm: tf.Tensor) -> CameraParams[Scalar]:
    """Return the camera with a blur of `blur_mm` in every image."""
    return dataclasses.replace(camera, blurred=tf.constant(True), blur_mm=blur_mm)
