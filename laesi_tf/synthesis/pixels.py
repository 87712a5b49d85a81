"""What becomes of one pixel: sheet and desk, leaf, light, camera, each a few products and sums, in one loop.

The fields that the loops read (coverage, noise, softened shadows) are made beforehand; a field is missing
where its component is left out of every picture. Images are [3, H, W] and fields [H, W] in [0, 1].
"""

from typing import Any, NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import camera, desk, light, paper, surface
from laesi_tf.synthesis.camera import Camera
from laesi_tf.synthesis.desk import Desk
from laesi_tf.synthesis.frame import Size
from laesi_tf.synthesis.fusing import fused
from laesi_tf.synthesis.light import Light
from laesi_tf.synthesis.paper import Paper
from laesi_tf.synthesis.surface import Surface

Field = Any
"""A tensor, or None where the component is left out."""


class Print(NamedTuple):
    """Fields of the sheet: its shade by noise and creases, its ink's strength, its fine and heavy lines."""

    shade: tf.Tensor
    strength: Field = None
    lines: tuple[tf.Tensor, tf.Tensor] | None = None


class Blade(NamedTuple):
    """Fields of the leaf, named after the functions of `surface` that make them."""

    coverage: tf.Tensor
    blend: Field = None
    mottle: Field = None
    texture: Field = None
    inwardness: Field = None
    spots: Field = None
    ridges: Field = None
    facing: Field = None


@fused
def creased(sheet: Paper, shade: tf.Tensor, to_px: tf.Tensor, fov_mm: tf.Tensor) -> tf.Tensor:
    """`shade` [H, W] with a fold across it."""
    return shade + paper.crease(sheet, *camera.sheet_coordinates(to_px, tuple(shade.shape)), fov_mm)


@fused
def ruled(sheet: Paper, passing: tf.Tensor, to_px: tf.Tensor, size: Size) -> tuple[tf.Tensor, tf.Tensor]:
    """Coverage [H, W] by the fine and the heavy lines of a sheet with `transmission` `passing`."""
    return paper.ruling(sheet, passing, *camera.sheet_coordinates(to_px, size))


@fused
def margin(sheet: Paper, extent: tf.Tensor, to_px: tf.Tensor, size: Size) -> tf.Tensor:
    """Distance [H, W] in mm from the end of a sheet around a leaf; `extent` [2, 2] are corners of its box."""
    return paper.margin(sheet, extent, *camera.sheet_coordinates(to_px, size))


@fused
def filling(sheet: Paper, made: Print) -> tf.Tensor:
    """A sheet that fills the frame."""
    return paper.colour(sheet) * made.shade * (1 - _inks(sheet, made))


@fused
def on_desk(
    sheet: Paper, made: Print, top: Desk, grain: tf.Tensor, distance: tf.Tensor, px_per_mm: tf.Tensor
) -> tf.Tensor:
    """A sheet that ends, by its `margin` `distance`, on a desk with `grain`."""
    printed = tf.clip_by_value((distance - sheet.border_mm) * px_per_mm + 0.5, 0, 1)
    on_sheet = tf.clip_by_value(distance * px_per_mm + 0.5, 0, 1)
    table = desk.desk(top, grain, distance)
    page = paper.colour(sheet) * made.shade * (1 - printed * _inks(sheet, made))
    return table + on_sheet * (page - table)


def _inks(sheet: Paper, made: Print) -> tf.Tensor | float:
    if made.lines is None:
        return 0.0
    inks = paper.absorbed(sheet, *made.lines)
    return inks if made.strength is None else inks * made.strength


@fused
def facing(height: tf.Tensor, lit: Light, px_per_mm: tf.Tensor) -> tf.Tensor:
    """How far [H, W] the surface of a height map in mm leans towards the light."""
    return light.facing(surface.normals(height, px_per_mm), lit)


@fused
def with_leaf(image: tf.Tensor, blade: Blade, shadow: Field, skin: Surface, lit: Light) -> tf.Tensor:
    """The scene `image` with the leaf and its shadow on it."""
    if shadow is not None:
        image = light.shaded(image, shadow, lit)
    return image + blade.coverage * (_leaf(blade, skin, lit) - image)


@fused
def exposed(
    image: tf.Tensor, illumination: Field, reflected: Field, held: Camera | None, sheet: Paper
) -> tf.Tensor:
    """`image` lit, seen through glass, and developed where a camera is `held`.

    A loop of its own: every channel needs all three of what it starts from.
    """
    if illumination is not None:
        image *= illumination
    if reflected is not None:
        image = light.behind_glass(image, reflected)
    return image if held is None else camera.develop(image, held, paper.colour(sheet))


def _leaf(blade: Blade, skin: Surface, lit: Light) -> tf.Tensor:
    if blade.blend is None or blade.mottle is None:
        return surface.base_colours(skin)[0]
    colour = surface.blade(skin, blade.blend, blade.mottle, blade.texture)
    if blade.inwardness is not None:
        colour = surface.browned_margin(colour, skin, blade.inwardness)
    if blade.spots is not None:
        colour = surface.spotted(colour, skin, blade.spots)
    if blade.ridges is not None:
        colour = surface.vein_tint(colour, skin, blade.ridges)
    if blade.facing is not None:
        colour = light.relief(colour, blade.facing, lit)
    return colour


@fused
def noisy(image: tf.Tensor, held: Camera, grain: tf.Tensor) -> tf.Tensor:
    """`image` with sensor noise."""
    return camera.sensor_noise(image, held, grain)


@fused
def quantised(image: tf.Tensor, held: Camera, grain: Field) -> tf.Tensor:
    """`image` as bytes [H, W, 3], with sensor noise first where there is `grain`."""
    if grain is not None:
        image = camera.sensor_noise(image, held, grain)
    return tf.cast(tf.transpose(tf.clip_by_value(image * 255 + 0.5, 0, 255), [1, 2, 0]), tf.uint8)
