"""Paint the leaf onto the sheet: coverage, colour, relief, shadow.

`components` names the components that images may have. Images are [3, H, W] and fields [H, W] in [0, 1].
"""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import light as lighting
from laesi_tf.synthesis import noise, rasterizer
from laesi_tf.synthesis.filters import blur_and_shift
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.leaf import surface as surfaces
from laesi_tf.synthesis.leaf.surface import SurfaceNoiseGrids, SurfaceParams
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.ranges import Scalar


class LeafInputs(NamedTuple):
    """What a leaf is painted from.

    `outline_sums` and `vein_sums` are cell sums of the edges of its outline and of its veins (None without
    veins), `grids` the numbers of its noise fields, `texture` [3, H, W] a photo's relief or None.
    """

    outline_sums: tf.Tensor
    vein_sums: tf.Tensor | None
    grids: SurfaceNoiseGrids
    texture: tf.Tensor | None


class UnshadedLeaf(NamedTuple):
    """A leaf without light and shadow.

    `coverage` [H, W], `colour` [3, H, W] or [3, 1, 1], `slopes` dH/dx and dH/dy [H, W] (None without relief).
    """

    coverage: tf.Tensor
    colour: tf.Tensor
    slopes: tuple[tf.Tensor, tf.Tensor] | None


def composite_leaf(
    image: tf.Tensor,
    inputs: LeafInputs,
    surface: SurfaceParams[Scalar],
    light: LightParams[Scalar],
    px_per_mm: tf.Tensor,
    components: tuple[str, ...],
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the scene `image` [3, H, W] with the leaf and its shadow, and the mask uint8 [H, W] 0/1."""
    leaf, mask = paint_leaf(inputs, surface, px_per_mm, (image.shape[1], image.shape[2]), components)
    return shade_leaf(image, leaf, light, px_per_mm, components), mask


def paint_leaf(
    inputs: LeafInputs,
    surface: SurfaceParams[Scalar],
    px_per_mm: tf.Tensor,
    size: ImageSize,
    components: tuple[str, ...],
) -> tuple[UnshadedLeaf, tf.Tensor]:
    """Return the leaf without light and shadow, and its mask uint8 [H, W] 0/1."""
    # The outline runs clockwise, which fills with -1. Where the edge crosses itself the orientation is the
    # opposite: that is leaf neither for the mask nor for the label.
    coverage = tf.clip_by_value(-rasterizer.integrate_coverage(inputs.outline_sums, size)[0], 0, 1)
    veins = None
    if inputs.vein_sums is not None:
        veins = rasterizer.union_coverage(rasterizer.integrate_coverage(inputs.vein_sums, size)[0])
    if "surface" in components:
        colour = leaf_colour(coverage, veins, inputs, surface, px_per_mm, components)
    else:
        colour = surfaces.base_colours(surface)[0]
    slopes = None
    if "relief" in components:
        height_mm = leaf_height_map(veins, surface, inputs.grids, px_per_mm, components, size)
        slopes = surfaces.height_slopes(height_mm, px_per_mm)
    return UnshadedLeaf(coverage, colour, slopes), tf.cast(coverage + 0.5, tf.uint8)


def leaf_colour(
    coverage: tf.Tensor,
    veins: tf.Tensor | None,
    inputs: LeafInputs,
    surface: SurfaceParams[Scalar],
    px_per_mm: tf.Tensor,
    components: tuple[str, ...],
) -> tf.Tensor:
    """Return the colours [3, H, W] of the leaf's surface, from coverage by the leaf and its veins [H, W]."""
    size, grids = (coverage.shape[0], coverage.shape[1]), inputs.grids
    blend = surfaces.colour_blend_noise(surface, grids.blend, size)
    mottle = surfaces.mottle_noise(surface, grids.mottle, size)
    colour = surfaces.blend_leaf_colours(surface, blend, mottle, inputs.texture)
    if "browned_margin" in components:
        inwardness = tf.cond(
            surface.margin_browned,
            lambda: blur_and_shift(coverage, size, 3.0 * px_per_mm).values,
            lambda: tf.ones_like(coverage),
        )
        colour = surfaces.apply_browned_edge(colour, surface, inwardness)
    if "spots" in components:
        colour = surfaces.apply_spots(colour, surface, surfaces.spot_coverage(surface, grids.spots, size))
    return colour if veins is None else surfaces.apply_vein_colour(colour, surface, veins)


def leaf_height_map(
    veins: tf.Tensor | None,
    surface: SurfaceParams[Scalar],
    grids: SurfaceNoiseGrids,
    px_per_mm: tf.Tensor,
    components: tuple[str, ...],
    size: ImageSize,
) -> tf.Tensor:
    """Return the height [H, W] of the leaf's surface in mm: raised veins, a bulging blade between them."""
    height = noise.zero_field(size)
    if "undulation" in components:
        height += surfaces.undulation_height(surface, grids.undulation, size)
    if veins is None:
        return height.values
    bulge = blur_and_shift(veins, size, 1.2 * px_per_mm) * (-1.6 * surface.quilting)
    return (height + bulge).values + 0.12 * veins


def shade_leaf(
    image: tf.Tensor,
    leaf: UnshadedLeaf,
    light: LightParams[Scalar],
    px_per_mm: tf.Tensor,
    components: tuple[str, ...],
) -> tf.Tensor:
    """Return the scene `image` [3, H, W] with the leaf's shadow and the leaf itself, shaded by its relief."""
    if "shadow" in components:
        size = (image.shape[1], image.shape[2])
        depth = lighting.shadow_depth(leaf.coverage, light, size, px_per_mm)
        image = lighting.apply_shadow(image, depth, light)
    colour = leaf.colour
    if leaf.slopes is not None:
        slope = lighting.slope_towards_light(leaf.slopes, light)
        colour = lighting.shade_relief(colour, slope, light)
    return image + leaf.coverage * (colour - image)
