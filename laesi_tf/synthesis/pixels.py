"""What becomes of the pixels: sheet and desk, leaf, light, camera, each compiled into a few loops.

Images are [3, H, W] and fields [H, W] in [0, 1]. `parts` names the components that pictures may have.
"""

from typing import Any, NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import camera, desk, light, noise, paper, raster, surface, veins
from laesi_tf.synthesis.camera import Camera, View
from laesi_tf.synthesis.desk import Desk
from laesi_tf.synthesis.frame import Size
from laesi_tf.synthesis.fusing import fused
from laesi_tf.synthesis.light import Light
from laesi_tf.synthesis.paper import Paper
from laesi_tf.synthesis.surface import Surface

Parts = tuple[str, ...]
Field = Any
"""A tensor, or None where the component is left out."""


class Blade(NamedTuple):
    """What a leaf's fields are made of: sums of what its edges and, where it has them, its veins' leave, the
    numbers behind its noises, and its photographed texture."""

    edge_heights: list[tf.Tensor]
    drawn: surface.Lattices
    texture: Field


@fused
def ruled(sheet: Paper, to_px: tf.Tensor, size: Size) -> tf.Tensor:
    """Where in its ruling's period a sheet is seen: `paper.places` int32 [2, H, W].

    Compiled apart from `page`, where finding a place would slow down looking it up.
    """
    return paper.places(sheet, paper.samples_per_mm(size), *camera.sheet_coordinates(to_px, size))


@fused
def page(
    sheet: Paper,
    worn: paper.Lattices,
    table: Desk,
    grain: tf.Tensor,
    extent: tf.Tensor,
    view: View,
    where: Field,
    size: Size,
    parts: Parts,
) -> tf.Tensor:
    """The sheet, and the desk where the sheet ends: [3, H, W].

    `extent` [2, 2] are corners of the leaf's box, `where` are the places of the ruling, if there is one.
    """
    shade, strength, lines = tf.ones(size), None, None
    if "paper_noise" in parts:
        blend, strength = paper.wear(sheet, worn, size)
        shade += blend
    if "crease" in parts:
        shade = tf.cond(
            sheet.creased,
            lambda: shade + paper.crease(sheet, *camera.sheet_coordinates(view.to_px, size), view.fov_mm),
            lambda: shade,
        )
    if where is not None:
        passing = paper.transmission(sheet, paper.samples_per_mm(size), 1 / view.px_per_mm)
        lines = paper.ruling(passing, where)

    def inks() -> tf.Tensor | float:
        if lines is None:
            return 0.0
        absorbed = paper.absorbed(sheet, *lines)
        return absorbed if strength is None else absorbed * strength

    def filling() -> tf.Tensor:
        return paper.colour(sheet) * shade * (1 - inks())

    def on_desk() -> tf.Tensor:
        distance = paper.margin(sheet, extent, *camera.sheet_coordinates(view.to_px, size))
        printed = tf.clip_by_value((distance - sheet.border_mm) * view.px_per_mm + 0.5, 0, 1)
        on_sheet = tf.clip_by_value(distance * view.px_per_mm + 0.5, 0, 1)
        beyond = desk.desk(table, desk.grain(table, grain, size), distance)
        return beyond + on_sheet * (paper.colour(sheet) * shade * (1 - printed * inks()) - beyond)

    return tf.cond(sheet.edged, on_desk, filling) if "desk" in parts else filling()


class Unlit(NamedTuple):
    """A leaf before light falls on it: coverage and slopes (dH/dx and dH/dy) [H, W], colour [3, H, W] or
    [3, 1, 1]."""

    coverage: tf.Tensor
    colour: tf.Tensor
    slopes: Field


@fused
def with_leaf(
    image: tf.Tensor, blade: Blade, skin: Surface, lit: Light, px_per_mm: tf.Tensor, parts: Parts
) -> tuple[tf.Tensor, tf.Tensor]:
    """The scene `image` with the leaf and its shadow on it, and the leaf's mask uint8 [H, W]."""
    leaf, mask = _unlit(blade, skin, px_per_mm, (image.shape[1], image.shape[2]), parts)
    return _lit(image, leaf, lit, px_per_mm, parts), mask


@fused
def unlit(
    blade: Blade, skin: Surface, px_per_mm: tf.Tensor, size: Size, parts: Parts
) -> tuple[Unlit, tf.Tensor]:
    """The leaf as several lighting passes find it, and its mask uint8 [H, W]."""
    return _unlit(blade, skin, px_per_mm, size, parts)


@fused
def in_light(image: tf.Tensor, leaf: Unlit, lit: Light, px_per_mm: tf.Tensor, parts: Parts) -> tf.Tensor:
    """What `with_leaf` makes of `image`, in one of several lights."""
    return _lit(image, leaf, lit, px_per_mm, parts)


def _unlit(
    blade: Blade, skin: Surface, px_per_mm: tf.Tensor, size: Size, parts: Parts
) -> tuple[Unlit, tf.Tensor]:
    # The outline runs clockwise, which fills with -1. Where a margin crosses itself it turns the other way:
    # that is leaf neither for the mask nor for the label.
    coverage = tf.clip_by_value(-raster.accumulated(blade.edge_heights[0], size)[0], 0, 1)
    ridges = None
    if "veins" in parts:
        ridges = veins.height(raster.accumulated(blade.edge_heights[1], size)[0])
    if "surface" in parts:
        colour = _skin(coverage, ridges, blade, skin, px_per_mm, parts)
    else:
        colour = surface.base_colours(skin)[0]
    slopes = None
    if "relief" in parts:
        slopes = surface.normals(_height(ridges, skin, blade.drawn, px_per_mm, parts, size), px_per_mm)
    return Unlit(coverage, colour, slopes), tf.cast(coverage + 0.5, tf.uint8)


def _lit(image: tf.Tensor, leaf: Unlit, lit: Light, px_per_mm: tf.Tensor, parts: Parts) -> tf.Tensor:
    if "shadow" in parts:
        depth = light.shadow(leaf.coverage, lit, (image.shape[1], image.shape[2]), px_per_mm)
        image = light.shaded(image, depth, lit)
    colour = leaf.colour
    if leaf.slopes is not None:
        colour = light.relief(colour, light.facing(leaf.slopes, lit), lit)
    return image + leaf.coverage * (colour - image)


def _skin(
    coverage: tf.Tensor, ridges: Field, blade: Blade, skin: Surface, px_per_mm: tf.Tensor, parts: Parts
) -> tf.Tensor:
    """The colours [3, H, W] of the leaf's surface."""
    size, drawn = (coverage.shape[0], coverage.shape[1]), blade.drawn
    blend, mottle = surface.blend(skin, drawn.blend, size), surface.mottle(skin, drawn.mottle, size)
    colour = surface.blade(skin, blend, mottle, blade.texture)
    if "browned_margin" in parts:
        inwardness = tf.cond(
            skin.margin_browned,
            lambda: light.soften(coverage, size, 3.0 * px_per_mm).field,
            lambda: tf.ones_like(coverage),
        )
        colour = surface.browned_margin(colour, skin, inwardness)
    if "spots" in parts:
        colour = surface.spotted(colour, skin, surface.spots(skin, drawn.spots, size))
    return colour if ridges is None else surface.vein_tint(colour, skin, ridges)


def _height(
    ridges: Field, skin: Surface, drawn: surface.Lattices, px_per_mm: tf.Tensor, parts: Parts, size: Size
) -> tf.Tensor:
    """Height map [H, W] of the leaf's surface in mm: the blade bulges between veins that stand proud."""
    height = noise.Factors(tf.zeros([size[0], 1]), tf.zeros([size[1], 1]))
    if "undulation" in parts:
        height += surface.undulation(skin, drawn.undulation, size)
    if ridges is None:
        return height.field
    bulge = light.soften(ridges, size, 1.2 * px_per_mm) * (-1.6 * skin.quilting)
    return (height + bulge).field + 0.12 * ridges


@fused
def exposed(
    image: tf.Tensor, lit: Light, unevenness: tf.Tensor, held: Camera, sheet: Paper, parts: Parts
) -> tf.Tensor:
    """`image` lit, seen through glass, and developed.

    A loop of its own: every channel needs all three of what it starts from.
    """
    size = image.shape[1], image.shape[2]
    if "illumination" in parts:
        image *= light.illumination(lit, unevenness, size)
    if "glass" in parts:
        image = light.behind_glass(image, light.glass(lit, size))
    return camera.develop(image, held, paper.colour(sheet)) if "development" in parts else image


@fused
def crisp(image: tf.Tensor, held: Camera, grain: Field) -> tf.Tensor:
    """`image` as the sensor has it, with its `grain` [3, H, W]: bytes [H, W, 3]."""
    return _quantised(_noisy(image, held, grain))


@fused
def softened(image: tf.Tensor, held: Camera, grain: Field) -> tuple[tf.Tensor, tf.Tensor]:
    """`image` with its sensor noise, and the colours that a compressed file keeps of it."""
    grained = _noisy(image, held, grain)
    return grained, camera.halved_chroma(grained)


@fused
def compressed(image: tf.Tensor, chroma: tf.Tensor) -> tf.Tensor:
    """`image` with the colours `chroma` that its file has kept: bytes [H, W, 3]."""
    return _quantised(camera.with_chroma(image, chroma))


def _noisy(image: tf.Tensor, held: Camera, grain: Field) -> tf.Tensor:
    return image if grain is None else camera.sensor_noise(image, held, grain)


def _quantised(image: tf.Tensor) -> tf.Tensor:
    return tf.cast(tf.transpose(tf.clip_by_value(image * 255 + 0.5, 0, 255), [1, 2, 0]), tf.uint8)
