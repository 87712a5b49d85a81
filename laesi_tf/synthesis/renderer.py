"""The compositing order of a synthetic image, from top to bottom."""

from collections.abc import Sequence
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import kernels, light, rasterizer
from laesi_tf.synthesis.camera import imaging
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.kernels import Components
from laesi_tf.synthesis.leaf import surface, veins
from laesi_tf.synthesis.paper import desk
from laesi_tf.synthesis.paper.sheet import sample_sheet_noise_grids
from laesi_tf.synthesis.props import drawing, placement
from laesi_tf.synthesis.random_streams import Stream
from laesi_tf.synthesis.scene import COMPONENTS, Ranges, Scene
from laesi_tf.synthesis.scene_layout import SceneLayout, compute_layout, leaf_edge_contributions


class SharedLayers(NamedTuple):
    """What lighting passes over one leaf have in common: where everything is, sheet and desk with what lies
    on them [3, H, W], and what the leaf is made of."""

    place: SceneLayout
    sheet: tf.Tensor
    blade: kernels.LeafInputs


def render_scene(
    scene: Scene, size: ImageSize, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> dict[str, tf.Tensor]:
    """Turn the numbers of a scene into a picture of `size` (height, width).

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's
    centroid) and `tilt_deg` float32 [], `to_px` float32 [3, 3], sheet mm to pixels, and `kind` int32 [],
    which of the ranges' kinds of leaves it is.
    """
    parts = _enabled_components(ranges)
    laid = _prepare_layers(scene, size, parts, textures)
    image, mask = kernels.composite_leaf(
        laid.sheet, laid.blade, scene.surface, scene.light, laid.place.view.px_per_mm, parts
    )
    return _finish_sample(image, mask, scene, laid.place, parts)


def render_lighting_passes(
    passes: Sequence[Scene], size: ImageSize, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> list[dict[str, tf.Tensor]]:
    """The pictures, each as `render` makes it, of scenes that differ in their light alone."""
    parts = _enabled_components(ranges)
    laid = _prepare_layers(passes[0], size, parts, textures)
    px_per_mm = laid.place.view.px_per_mm
    leaf, mask = kernels.paint_leaf(laid.blade, passes[0].surface, px_per_mm, size, parts)
    return [
        _finish_sample(
            kernels.shade_leaf(laid.sheet, leaf, scene.light, px_per_mm, parts),
            mask,
            scene,
            laid.place,
            parts,
        )
        for scene in passes
    ]


def _enabled_components(ranges: Ranges) -> Components:
    return tuple(name for name in COMPONENTS if ranges.has(name))


def _prepare_layers(
    scene: Scene, size: ImageSize, parts: Components, textures: tf.Tensor | None
) -> SharedLayers:
    key, place = scene.key, compute_layout(scene, size)
    view = place.view
    extent = tf.stack([tf.reduce_min(place.outline, axis=0), tf.reduce_max(place.outline, axis=0)])
    where = kernels.compute_ruling_cells(scene.paper, view.to_px, size) if "ruling" in parts else None
    sheet = kernels.paint_sheet_and_desk(
        scene.paper,
        sample_sheet_noise_grids(key),
        scene.desk,
        desk.sample_desk_noise_grid(key),
        extent,
        view,
        where,
        size,
        parts,
    )
    stage = placement.PropContext(leaf=place.outline, view=view, size=size)
    sheet = drawing.draw_props(
        sheet, scene.props, stage, key, [name for name in drawing.PROPS if name in parts]
    )
    left = leaf_edge_contributions(
        place, scene.leaf, scene.surface, veins.sample_turtle_noise(key), size, parts
    )
    texture = None if textures is None else surface.sample_leaf_texture(textures, key, size)
    heights = [rasterizer.sum_contributions(deposits, size) for deposits in left]
    return SharedLayers(
        place, sheet, kernels.LeafInputs(heights, surface.sample_surface_noise_grids(key), texture)
    )


def _finish_sample(
    image: tf.Tensor, mask: tf.Tensor, scene: Scene, place: SceneLayout, parts: Components
) -> dict[str, tf.Tensor]:
    """What `render` returns, of what there is to be seen [3, H, W] and the leaf's mask."""
    light_numbers = light.sample_illumination_grid(scene.light_key)
    exposed = kernels.apply_light_and_tone(
        image, scene.light, light_numbers, scene.camera, scene.paper, parts
    )
    return {
        "image": _simulate_sensor(exposed, scene, place, parts),
        "mask": mask,
        "area_cm2": place.area_cm2,
        "px_per_mm": place.view.px_per_mm,
        "tilt_deg": scene.camera.tilt_deg * tf.cast(scene.camera.tilted, tf.float32),
        "to_px": place.view.to_px,
        "kind": scene.kind,
    }


def _simulate_sensor(image: tf.Tensor, scene: Scene, place: SceneLayout, parts: Components) -> tf.Tensor:
    """What lens, sensor and file make of the exposed image [3, H, W]: bytes [H, W, 3]."""
    held, grain = scene.camera, None
    if "focus" in parts:
        image = imaging.apply_focus_blur(image, held, place.view.px_per_mm)
    if "sensor_noise" in parts:
        cut = scene.light_key.uniform([2], Stream.SENSOR)
        grain = imaging.cut_sensor_noise(cut, (image.shape[1], image.shape[2]))

    def crisp() -> tf.Tensor:
        return kernels.record_crisp(image, held, grain)

    def compressed() -> tf.Tensor:
        return kernels.restore_and_quantise(*kernels.record_with_chroma(image, held, grain))

    return tf.cond(held.compressed, compressed, crisp) if "chroma_softness" in parts else crisp()
