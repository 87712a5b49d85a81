"""The compositing order of a synthetic image, from top to bottom.

1. Layout: the leaf's outline and holes on the sheet, the camera's view, the label. On an empty sheet the leaf
   only places the camera: it is removed before step 3, so that mask and shadow are empty and the area is 0.
2. Sheet: noise, crease, ruling; the desk around it.
3. Props, from flat to high.
4. The leaf's shadow; the leaf: colour, browned edge, spots, veins, undulation and relief; its mask.
5. Clear props over the leaf. Light and tone: illumination, the photographer's shadow, glare, reflection of
   glass, white balance, exposure, contrast, saturation.
6. Camera: focus blur, sensor noise, sharpening, chroma at half the resolution, 8 bits.
7. File: resizing and JPEG.

This module holds no arithmetic. Each `kernels.x` is the XLA-compiled form of the plain function `x` of the
module that `kernels` names. A stage receives the names of its components that images may contain.
"""

from collections.abc import Sequence
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import geometry, kernels, rasterizer
from laesi_tf.synthesis.camera import file, recording
from laesi_tf.synthesis.camera.view import tilt_deg
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.leaf.outline import OUTLINE_POINTS, OutlineCurve
from laesi_tf.synthesis.leaf.painting import LeafInputs
from laesi_tf.synthesis.leaf.surface import cut_leaf_texture
from laesi_tf.synthesis.props.drawing import composite_prop, round_up_side
from laesi_tf.synthesis.props.placement import PropContext
from laesi_tf.synthesis.props.registry import PROPS, SampledProp
from laesi_tf.synthesis.scene import Scene
from laesi_tf.synthesis.scene_layout import SceneLayout, shrink_leaf_if

_SHEET = ("paper_noise", "crease", "ruling", "paper_kinds", "desk", "desk_kinds", "cut_sheet")
_VIEW = ("lens", "bend")
_LEAF = (
    "surface",
    "browned_margin",
    "pale_margin",
    "spots",
    "veins",
    "red_petiole",
    "undulation",
    "relief",
)
_FILE = ("resizing", "jpeg")
_LIGHT = ("illumination", "photographer", "glass", "glare", "development")


class SharedLayers(NamedTuple):
    """What lighting passes over one leaf share.

    The layout, the `background` [3, H, W] of sheet, desk and props, and what the leaf is painted from.
    """

    layout: SceneLayout
    background: tf.Tensor
    leaf: LeafInputs


def render_scene(
    scene: Scene,
    size: ImageSize,
    *,
    layout: SceneLayout | None = None,
    textures: tf.Tensor | None = None,
) -> dict[str, tf.Tensor]:
    """Render a scene as an image of `size` (height, width) in pixels.

    `layout` replaces the scene's own, for another view of it.
    `textures` [N, T, T, 3] are photos of leaves relative to mean 1. Returns `image` uint8 [H, W, 3], `mask`
    uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's area centroid) and `tilt_deg` float32 [], `to_px`
    float32 [3, 3] (homography from sheet mm to pixels, without lens and bend), and `kind` int32 [], the
    position of the leaf's kind in the ranges. On an empty sheet `mask` and `area_cm2` are 0, and `kind` has
    no meaning.
    """
    layers = _prepare_layers(scene, layout or compute_layout(scene, size), size, textures)
    px_per_mm = layers.layout.view.px_per_mm
    image, mask = kernels.composite_leaf(
        layers.background,
        layers.leaf,
        scene.surface,
        scene.light,
        px_per_mm,
        _enabled(scene, "shadow", *_LEAF),
    )
    return _finish_sample(image, mask, scene, layers.layout)


def render_lighting_passes(
    scenes: Sequence[Scene], size: ImageSize, *, textures: tf.Tensor | None = None
) -> list[dict[str, tf.Tensor]]:
    """Render scenes that differ in their light only; returns one sample per scene, as `render_scene` does."""
    first = scenes[0]
    layers = _prepare_layers(first, compute_layout(first, size), size, textures)
    px_per_mm = layers.layout.view.px_per_mm
    leaf, mask = kernels.paint_leaf(layers.leaf, first.surface, px_per_mm, size, _enabled(first, *_LEAF))
    samples = []
    for scene in scenes:
        image = kernels.shade_leaf(layers.background, leaf, scene.light, px_per_mm, _enabled(scene, "shadow"))
        samples.append(_finish_sample(image, mask, scene, layers.layout))
    return samples


def _prepare_layers(
    scene: Scene, layout: SceneLayout, size: ImageSize, textures: tf.Tensor | None
) -> SharedLayers:
    """Paint sheet, desk and props, and rasterise the edges of the leaf, if there is one."""
    background = _paint_sheet(scene, layout, size)
    painted = layout
    if "empty_sheet" in scene.components:
        painted = layout.remove_leaf_if(scene.paper.empty)
    # On an empty sheet props lie where the leaf would be.
    background = draw_props(background, scene, painted, size)
    leaf = _prepare_leaf(scene, painted, size, textures)
    return SharedLayers(layout._replace(area_cm2=painted.area_cm2), background, leaf)


def compute_layout(scene: Scene, size: ImageSize) -> SceneLayout:
    """Place the leaf on the sheet and point the camera at it."""
    leaf = scene.leaf
    if "empty_sheet" in scene.components:
        leaf = shrink_leaf_if(leaf, scene.paper.empty)
    points, lengths = kernels.trace_outline(leaf, scene.numbers.outline)
    curve = OutlineCurve(points, lengths, geometry.find_segments(lengths, OUTLINE_POINTS))
    # The size as a tensor: one compilation serves all sizes, and the label is the same at each.
    size_tensor = tf.constant(size, tf.float32)
    return kernels.compute_layout(
        leaf, scene.camera, curve, scene.numbers.holes, size_tensor, _enabled(scene, *_VIEW)
    )


def _paint_sheet(scene: Scene, layout: SceneLayout, size: ImageSize) -> tf.Tensor:
    """Paint sheet noise, crease and ruling, and the desk around the sheet: [3, H, W]."""
    components, cells = _enabled(scene, *_SHEET), None
    if "ruling" in components:
        cells = kernels.compute_ruling_cells(scene.paper, layout.view, size, _enabled(scene, "paper_kinds"))
    return kernels.paint_sheet_and_desk(
        scene.paper,
        scene.numbers.sheet,
        scene.desk,
        scene.numbers.desk,
        layout.outline,
        layout.view,
        cells,
        size,
        components,
    )


def draw_props(
    image: tf.Tensor, scene: Scene, layout: SceneLayout, size: ImageSize, *, covers_leaf: bool = False
) -> tf.Tensor:
    """Draw the props that the scene has over [3, H, W], from flat to high: beside the leaf or covering it."""
    context = PropContext(layout.outline, layout.view, tf.constant(size[::-1], tf.float32))

    def draw(prop: SampledProp, image: tf.Tensor) -> tf.Tensor:
        raster = kernels.rasterise_prop(
            prop.name,
            prop.params,
            prop.largest,
            context,
            prop.numbers,
            round_up_side(size),
            scene.closest_mm,
        )
        return composite_prop(image, raster, size)

    props = [prop for prop in scene.props.values() if PROPS[prop.name].covers_leaf == covers_leaf]
    for prop in props:
        image = tf.cond(
            prop.is_present,
            lambda image=image, prop=prop: draw(prop, image),
            lambda image=image: image,
        )
    return image


def _prepare_leaf(
    scene: Scene, layout: SceneLayout, size: ImageSize, textures: tf.Tensor | None
) -> LeafInputs:
    """Rasterise the edges of the leaf and its veins, and cut its texture."""
    outline_edges, vein_edges = kernels.leaf_contributions(
        layout,
        scene.leaf,
        scene.surface,
        scene.numbers.turtles,
        size,
        _enabled(scene, "veins", "red_petiole"),
        scene.closest_mm,
    )
    return LeafInputs(
        outline_sums=rasterizer.sum_contributions(outline_edges, size),
        vein_sums=None if vein_edges is None else rasterizer.sum_contributions(vein_edges, size),
        grids=scene.numbers.surface,
        texture=None if textures is None else cut_leaf_texture(textures, scene.numbers.texture, size),
    )


def _finish_sample(
    image: tf.Tensor, mask: tf.Tensor, scene: Scene, layout: SceneLayout
) -> dict[str, tf.Tensor]:
    """Draw what covers the leaf, apply light, tone and camera; returns what `render_scene` returns."""
    exposed = kernels.apply_light_and_tone(
        draw_props(image, scene, layout, (image.shape[1], image.shape[2]), covers_leaf=True),
        scene.light,
        scene.light_numbers.illumination,
        scene.camera,
        scene.paper,
        _enabled(scene, *_LIGHT),
    )
    return {
        "image": _record(exposed, scene, layout.view.px_per_mm),
        "mask": mask,
        "area_cm2": layout.area_cm2,
        "px_per_mm": layout.view.px_per_mm,
        "tilt_deg": tilt_deg(scene.camera),
        "to_px": layout.view.to_px,
        "kind": scene.kind,
    }


def _record(exposed: tf.Tensor, scene: Scene, px_per_mm: tf.Tensor) -> tf.Tensor:
    """Apply focus blur, sensor noise, sharpening, chroma, 8 bits and the file: uint8 [H, W, 3]."""
    camera, image, noise = scene.camera, exposed, None
    if "sensor_noise" in scene.components:
        noise = recording.cut_sensor_noise(scene.light_numbers.sensor, (image.shape[1], image.shape[2]))
    if "focus" in scene.components:
        image = tf.cond(
            camera.blurred,
            lambda: kernels.apply_focus_blur(exposed, camera, px_per_mm, scene.closest_mm),
            lambda: exposed,
        )

    if "sharpening" in scene.components:
        # The noise comes first, since sharpening amplifies it.
        noisy = kernels.add_sensor_noise(image, camera, noise)
        image = tf.cond(camera.sharpened, lambda: kernels.sharpen(noisy, camera), lambda: noisy)
        noise = None

    def record_compressed() -> tf.Tensor:
        return kernels.record_with_chroma(*kernels.subsample_chroma(image, camera, noise))

    def record() -> tf.Tensor:
        return kernels.record(image, camera, noise)

    recorded = (
        tf.cond(camera.compressed, record_compressed, record)
        if "chroma_softness" in scene.components
        else record()
    )
    in_file = _enabled(scene, *_FILE)
    return file.compress(recorded, camera, in_file) if in_file else recorded


def _enabled(scene: Scene, *stage: str) -> tuple[str, ...]:
    """Return the enabled ones of a stage's components: the others must not make it compile anew."""
    return tuple(name for name in stage if name in scene.components)
