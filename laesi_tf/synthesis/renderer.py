"""The compositing order of a synthetic image, from top to bottom.

1. Layout: the leaf's outline and holes on the sheet, the camera's view, the label.
2. Sheet: noise, crease, ruling; the desk around it.
3. Props, from flat to high.
4. The leaf's shadow; the leaf: colour, browned edge, spots, veins, undulation and relief; its mask.
5. Light and tone: illumination, reflection of glass, white balance, exposure, contrast, saturation.
6. Camera: focus blur, sensor noise, chroma at half the resolution, 8 bits.

This module holds no arithmetic. Each `kernels.x` is the XLA-compiled form of the plain function `x` of the
module that `kernels` names. A stage receives the names of its components that images may contain.
"""

from collections.abc import Sequence
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import kernels, polygons, rasterizer
from laesi_tf.synthesis.camera import imaging
from laesi_tf.synthesis.camera.view import tilt_deg
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.leaf import holes, outline, surface, veins
from laesi_tf.synthesis.leaf.painting import LeafInputs
from laesi_tf.synthesis.light import sample_illumination_grid
from laesi_tf.synthesis.paper import desk, sheet
from laesi_tf.synthesis.props.drawing import composite_prop, round_up_side
from laesi_tf.synthesis.props.placement import SHAPE_NUMBERS, PropContext
from laesi_tf.synthesis.props.registry import PROPS, is_present, prop_ranges
from laesi_tf.synthesis.ranges import largest_params
from laesi_tf.synthesis.scene import Ranges, Scene
from laesi_tf.synthesis.scene_layout import SceneLayout

_SHEET = ("paper_noise", "crease", "ruling", "desk")
_LEAF = ("surface", "browned_margin", "spots", "veins", "undulation", "relief")
_LIGHT = ("illumination", "glass", "development")


class SharedLayers(NamedTuple):
    """What lighting passes over one leaf share.

    The layout, the `background` [3, H, W] of sheet, desk and props, and what the leaf is painted from.
    """

    layout: SceneLayout
    background: tf.Tensor
    leaf: LeafInputs


def render_scene(
    scene: Scene, size: ImageSize, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> dict[str, tf.Tensor]:
    """Render a scene as an image of `size` (height, width) in pixels.

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's area
    centroid) and `tilt_deg` float32 [], `to_px` float32 [3, 3] (homography from sheet mm to pixels), and
    `kind` int32 [], the position of the leaf's kind in the ranges.
    """
    components = ranges.enabled_components()
    layers = _prepare_layers(scene, size, ranges, textures)
    image, mask = kernels.composite_leaf(
        layers.background,
        layers.leaf,
        scene.surface,
        scene.light,
        layers.layout.view.px_per_mm,
        _among(components, "shadow", *_LEAF),
    )
    return _finish_sample(image, mask, scene, layers.layout, components)


def render_lighting_passes(
    scenes: Sequence[Scene], size: ImageSize, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> list[dict[str, tf.Tensor]]:
    """Render scenes that differ in their light only; returns one sample per scene, as `render_scene` does."""
    components = ranges.enabled_components()
    first = scenes[0]
    layers = _prepare_layers(first, size, ranges, textures)
    px_per_mm = layers.layout.view.px_per_mm
    leaf, mask = kernels.paint_leaf(layers.leaf, first.surface, px_per_mm, size, _among(components, *_LEAF))
    samples = []
    for scene in scenes:
        image = kernels.shade_leaf(
            layers.background, leaf, scene.light, px_per_mm, _among(components, "shadow")
        )
        samples.append(_finish_sample(image, mask, scene, layers.layout, components))
    return samples


def compute_layout(scene: Scene, size: ImageSize) -> SceneLayout:
    """Place the leaf on the sheet and point the camera at it."""
    points, lengths = kernels.trace_outline(scene.leaf, outline.sample_outline_numbers(scene.streams))
    segments = polygons.find_segments(lengths, outline.OUTLINE_POINTS)
    return kernels.compute_layout(
        scene.leaf,
        scene.camera,
        outline.OutlineCurve(points, lengths, segments),
        holes.sample_hole_numbers(scene.streams),
        # The size as a tensor: one compilation serves all sizes, and the label is the same at each.
        tf.constant(size, tf.float32),
    )


def _prepare_layers(
    scene: Scene, size: ImageSize, ranges: Ranges, textures: tf.Tensor | None
) -> SharedLayers:
    """Lay out the scene, paint sheet, desk and props, and sum up the edges of the leaf."""
    components = ranges.enabled_components()
    layout = compute_layout(scene, size)
    background = _paint_sheet(scene, layout, size, components)
    background = draw_props(background, scene, layout, size, ranges)
    return SharedLayers(layout, background, _prepare_leaf(scene, layout, size, components, textures))


def _paint_sheet(
    scene: Scene, layout: SceneLayout, size: ImageSize, components: tuple[str, ...]
) -> tf.Tensor:
    """Sheet noise, crease, ruling, then the desk around the sheet: [3, H, W]."""
    cells = None
    if "ruling" in components:
        cells = kernels.compute_ruling_cells(scene.paper, layout.view.to_px, size)
    return kernels.paint_sheet_and_desk(
        scene.paper,
        sheet.sample_sheet_noise_grids(scene.streams),
        scene.desk,
        desk.sample_desk_noise_grid(scene.streams),
        layout.leaf_box,
        layout.view,
        cells,
        size,
        _among(components, *_SHEET),
    )


def draw_props(
    image: tf.Tensor, scene: Scene, layout: SceneLayout, size: ImageSize, ranges: Ranges
) -> tf.Tensor:
    """Draw the props that the scene has over [3, H, W], from flat to high."""
    context = PropContext(layout.outline, layout.view.to_px, tf.constant(size[::-1], tf.float32))
    side = round_up_side(size)

    def draw(name: str, image: tf.Tensor) -> tf.Tensor:
        numbers = scene.streams.uniform([SHAPE_NUMBERS], PROPS[name].shape_stream)
        largest = largest_params(prop_ranges(name, ranges.props))
        raster = kernels.rasterise_prop(name, scene.props[name], largest, context, numbers, side)
        return composite_prop(image, raster, size)

    for name, params in scene.props.items():
        image = tf.cond(
            is_present(name, params),
            lambda image=image, name=name: draw(name, image),
            lambda image=image: image,
        )
    return image


def _prepare_leaf(
    scene: Scene,
    layout: SceneLayout,
    size: ImageSize,
    components: tuple[str, ...],
    textures: tf.Tensor | None,
) -> LeafInputs:
    """Rasterise the edges of leaf and veins, and sample the numbers of the leaf's surface."""
    outline_edges, vein_edges = kernels.leaf_contributions(
        layout,
        scene.leaf,
        scene.surface,
        veins.sample_turtle_noise(scene.streams),
        size,
        _among(components, "veins"),
    )
    return LeafInputs(
        outline_sums=rasterizer.sum_contributions(outline_edges, size),
        vein_sums=None if vein_edges is None else rasterizer.sum_contributions(vein_edges, size),
        grids=surface.sample_surface_noise_grids(scene.streams),
        texture=None if textures is None else surface.sample_leaf_texture(textures, scene.streams, size),
    )


def _finish_sample(
    image: tf.Tensor, mask: tf.Tensor, scene: Scene, layout: SceneLayout, components: tuple[str, ...]
) -> dict[str, tf.Tensor]:
    """Illumination, glass, white balance and tone, then the camera; returns what `render_scene` returns."""
    image = kernels.apply_light_and_tone(
        image,
        scene.light,
        sample_illumination_grid(scene.light_streams),
        scene.camera,
        scene.paper,
        _among(components, *_LIGHT),
    )
    return {
        "image": _record(image, scene, layout.view.px_per_mm, components),
        "mask": mask,
        "area_cm2": layout.area_cm2,
        "px_per_mm": layout.view.px_per_mm,
        "tilt_deg": tilt_deg(scene.camera),
        "to_px": layout.view.to_px,
        "kind": scene.kind,
    }


def _record(image: tf.Tensor, scene: Scene, px_per_mm: tf.Tensor, components: tuple[str, ...]) -> tf.Tensor:
    """Focus blur, sensor noise, chroma at half the resolution, 8 bits: uint8 [H, W, 3]."""
    camera, exposed, noise = scene.camera, image, None
    if "focus" in components:
        image = tf.cond(
            camera.blurred, lambda: kernels.apply_focus_blur(exposed, camera, px_per_mm), lambda: exposed
        )
    if "sensor_noise" in components:
        noise = imaging.cut_sensor_noise(scene.light_streams, (image.shape[1], image.shape[2]))

    def record_compressed() -> tf.Tensor:
        return kernels.record_with_chroma(*kernels.subsample_chroma(image, camera, noise))

    def record() -> tf.Tensor:
        return kernels.record(image, camera, noise)

    if "chroma_softness" not in components:
        return record()
    return tf.cond(camera.compressed, record_compressed, record)


def _among(components: tuple[str, ...], *stage: str) -> tuple[str, ...]:
    """Return those of a stage's components that are enabled: other components do not make it compile anew."""
    return tuple(name for name in stage if name in components)
