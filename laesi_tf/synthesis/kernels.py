"""What becomes of the pixels: sheet and desk, leaf, light, camera, each compiled into a few loops.

Images are [3, H, W] and fields [H, W] in [0, 1]. `parts` names the components that pictures may have.
"""

from typing import Any, NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import filters, geometry, light, noise, rasterizer
from laesi_tf.synthesis.camera import imaging
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.camera.view import CameraView
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.leaf import surface, veins
from laesi_tf.synthesis.leaf.surface import SurfaceParams
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.paper import desk, ruling
from laesi_tf.synthesis.paper.desk import DeskParams
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.paper.sheet import (
    SheetNoiseGrids,
    crease_shading,
    distance_to_sheet_edge,
    paper_noise,
    sheet_colour,
)
from laesi_tf.synthesis.xla import compile_with_xla

Components = tuple[str, ...]
Field = Any
"""A tensor, or None where the component is left out."""


class LeafInputs(NamedTuple):
    """What a leaf's fields are made of: sums of what its edges and, where it has them, its veins' leave, the
    numbers behind its noises, and its photographed texture."""

    edge_heights: list[tf.Tensor]
    drawn: surface.SurfaceNoiseGrids
    texture: Field


@compile_with_xla
def compute_ruling_cells(sheet: PaperParams, to_px: tf.Tensor, size: ImageSize) -> tf.Tensor:
    """Where in its ruling's period a sheet is seen: `paper.places` int32 [2, H, W].

    Compiled apart from `page`, where finding a place would slow down looking it up.
    """
    return ruling.ruling_cells(
        sheet, ruling.samples_per_mm(size), *geometry.pixel_centres_to_sheet(to_px, size)
    )


@compile_with_xla
def paint_sheet_and_desk(
    sheet: PaperParams,
    worn: SheetNoiseGrids,
    table: DeskParams,
    grain: tf.Tensor,
    extent: tf.Tensor,
    view: CameraView,
    where: Field,
    size: ImageSize,
    parts: Components,
) -> tf.Tensor:
    """The sheet, and the desk where the sheet ends: [3, H, W].

    `extent` [2, 2] are corners of the leaf's box, `where` are the places of the ruling, if there is one.
    """
    shade, strength, lines = tf.ones(size), None, None
    if "paper_noise" in parts:
        blend, strength = paper_noise(sheet, worn, size)
        shade += blend
    if "crease" in parts:
        shade = tf.cond(
            sheet.creased,
            lambda: (
                shade + crease_shading(sheet, *geometry.pixel_centres_to_sheet(view.to_px, size), view.fov_mm)
            ),
            lambda: shade,
        )
    if where is not None:
        passing = ruling.pack_line_transmission(sheet, ruling.samples_per_mm(size), 1 / view.px_per_mm)
        lines = ruling.look_up_line_coverage(passing, where)

    def inks() -> tf.Tensor | float:
        if lines is None:
            return 0.0
        absorbed = ruling.compute_ink_absorbance(sheet, *lines)
        return absorbed if strength is None else absorbed * strength

    def filling() -> tf.Tensor:
        return sheet_colour(sheet) * shade * (1 - inks())

    def on_desk() -> tf.Tensor:
        distance = distance_to_sheet_edge(sheet, extent, *geometry.pixel_centres_to_sheet(view.to_px, size))
        printed = tf.clip_by_value((distance - sheet.border_mm) * view.px_per_mm + 0.5, 0, 1)
        on_sheet = tf.clip_by_value(distance * view.px_per_mm + 0.5, 0, 1)
        beyond = desk.paint_desk(table, desk.desk_grain(table, grain, size), distance)
        return beyond + on_sheet * (sheet_colour(sheet) * shade * (1 - printed * inks()) - beyond)

    return tf.cond(sheet.edged, on_desk, filling) if "desk" in parts else filling()


class UnshadedLeaf(NamedTuple):
    """A leaf before light falls on it: coverage and slopes (dH/dx and dH/dy) [H, W], colour [3, H, W] or
    [3, 1, 1]."""

    coverage: tf.Tensor
    colour: tf.Tensor
    slopes: Field


@compile_with_xla
def composite_leaf(
    image: tf.Tensor,
    blade: LeafInputs,
    skin: SurfaceParams,
    lit: LightParams,
    px_per_mm: tf.Tensor,
    parts: Components,
) -> tuple[tf.Tensor, tf.Tensor]:
    """The scene `image` with the leaf and its shadow on it, and the leaf's mask uint8 [H, W]."""
    leaf, mask = _paint_leaf(blade, skin, px_per_mm, (image.shape[1], image.shape[2]), parts)
    return _shade_leaf(image, leaf, lit, px_per_mm, parts), mask


@compile_with_xla
def paint_leaf(
    blade: LeafInputs, skin: SurfaceParams, px_per_mm: tf.Tensor, size: ImageSize, parts: Components
) -> tuple[UnshadedLeaf, tf.Tensor]:
    """The leaf as several lighting passes find it, and its mask uint8 [H, W]."""
    return _paint_leaf(blade, skin, px_per_mm, size, parts)


@compile_with_xla
def shade_leaf(
    image: tf.Tensor, leaf: UnshadedLeaf, lit: LightParams, px_per_mm: tf.Tensor, parts: Components
) -> tf.Tensor:
    """What `with_leaf` makes of `image`, in one of several lights."""
    return _shade_leaf(image, leaf, lit, px_per_mm, parts)


def _paint_leaf(
    blade: LeafInputs, skin: SurfaceParams, px_per_mm: tf.Tensor, size: ImageSize, parts: Components
) -> tuple[UnshadedLeaf, tf.Tensor]:
    # The outline runs clockwise, which fills with -1. Where a margin crosses itself it turns the other way:
    # that is leaf neither for the mask nor for the label.
    coverage = tf.clip_by_value(-rasterizer.integrate_coverage(blade.edge_heights[0], size)[0], 0, 1)
    ridges = None
    if "veins" in parts:
        ridges = veins.vein_height(rasterizer.integrate_coverage(blade.edge_heights[1], size)[0])
    if "surface" in parts:
        colour = _leaf_colour(coverage, ridges, blade, skin, px_per_mm, parts)
    else:
        colour = surface.base_colours(skin)[0]
    slopes = None
    if "relief" in parts:
        slopes = surface.height_slopes(
            _leaf_height_map(ridges, skin, blade.drawn, px_per_mm, parts, size), px_per_mm
        )
    return UnshadedLeaf(coverage, colour, slopes), tf.cast(coverage + 0.5, tf.uint8)


def _shade_leaf(
    image: tf.Tensor, leaf: UnshadedLeaf, lit: LightParams, px_per_mm: tf.Tensor, parts: Components
) -> tf.Tensor:
    if "shadow" in parts:
        depth = light.shadow_depth(leaf.coverage, lit, (image.shape[1], image.shape[2]), px_per_mm)
        image = light.apply_shadow(image, depth, lit)
    colour = leaf.colour
    if leaf.slopes is not None:
        colour = light.shade_relief(colour, light.slope_towards_light(leaf.slopes, lit), lit)
    return image + leaf.coverage * (colour - image)


def _leaf_colour(
    coverage: tf.Tensor,
    ridges: Field,
    blade: LeafInputs,
    skin: SurfaceParams,
    px_per_mm: tf.Tensor,
    parts: Components,
) -> tf.Tensor:
    """The colours [3, H, W] of the leaf's surface."""
    size, drawn = (coverage.shape[0], coverage.shape[1]), blade.drawn
    blend, mottle = (
        surface.colour_blend_noise(skin, drawn.blend, size),
        surface.mottle_noise(skin, drawn.mottle, size),
    )
    colour = surface.blend_leaf_colours(skin, blend, mottle, blade.texture)
    if "browned_margin" in parts:
        inwardness = tf.cond(
            skin.margin_browned,
            lambda: filters.blur_and_shift(coverage, size, 3.0 * px_per_mm).field,
            lambda: tf.ones_like(coverage),
        )
        colour = surface.apply_browned_edge(colour, skin, inwardness)
    if "spots" in parts:
        colour = surface.apply_spots(colour, skin, surface.spot_coverage(skin, drawn.spots, size))
    return colour if ridges is None else surface.apply_vein_colour(colour, skin, ridges)


def _leaf_height_map(
    ridges: Field,
    skin: SurfaceParams,
    drawn: surface.SurfaceNoiseGrids,
    px_per_mm: tf.Tensor,
    parts: Components,
    size: ImageSize,
) -> tf.Tensor:
    """Height map [H, W] of the leaf's surface in mm: the blade bulges between veins that stand proud."""
    height = noise.SeparableField(tf.zeros([size[0], 1]), tf.zeros([size[1], 1]))
    if "undulation" in parts:
        height += surface.undulation_height(skin, drawn.undulation, size)
    if ridges is None:
        return height.field
    bulge = filters.blur_and_shift(ridges, size, 1.2 * px_per_mm) * (-1.6 * skin.quilting)
    return (height + bulge).field + 0.12 * ridges


@compile_with_xla
def apply_light_and_tone(
    image: tf.Tensor,
    lit: LightParams,
    unevenness: tf.Tensor,
    held: CameraParams,
    sheet: PaperParams,
    parts: Components,
) -> tf.Tensor:
    """`image` lit, seen through glass, and developed.

    A loop of its own: every channel needs all three of what it starts from.
    """
    size = image.shape[1], image.shape[2]
    if "illumination" in parts:
        image *= light.illumination(lit, unevenness, size)
    if "glass" in parts:
        image = light.add_glass_reflection(image, light.glass_reflection(lit, size))
    return (
        imaging.apply_white_balance_and_tone(image, held, sheet_colour(sheet))
        if "development" in parts
        else image
    )


@compile_with_xla
def record_crisp(image: tf.Tensor, held: CameraParams, grain: Field) -> tf.Tensor:
    """`image` as the sensor has it, with its `grain` [3, H, W]: bytes [H, W, 3]."""
    return _quantise(_add_sensor_noise(image, held, grain))


@compile_with_xla
def record_with_chroma(image: tf.Tensor, held: CameraParams, grain: Field) -> tuple[tf.Tensor, tf.Tensor]:
    """`image` with its sensor noise, and the colours that a compressed file keeps of it."""
    grained = _add_sensor_noise(image, held, grain)
    return grained, imaging.subsample_chroma(grained)


@compile_with_xla
def restore_and_quantise(image: tf.Tensor, chroma: tf.Tensor) -> tf.Tensor:
    """`image` with the colours `chroma` that its file has kept: bytes [H, W, 3]."""
    return _quantise(imaging.restore_chroma(image, chroma))


def _add_sensor_noise(image: tf.Tensor, held: CameraParams, grain: Field) -> tf.Tensor:
    return image if grain is None else imaging.add_sensor_noise(image, held, grain)


def _quantise(image: tf.Tensor) -> tf.Tensor:
    return tf.cast(tf.transpose(tf.clip_by_value(image * 255 + 0.5, 0, 255), [1, 2, 0]), tf.uint8)
