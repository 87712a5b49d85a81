"""Paint the leaf onto the sheet: coverage, colour, relief, shadow.

`components` names the components that images may have. Images are [3, H, W] and fields [H, W] in [0, 1].
"""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import light as lighting
from laesi_tf.synthesis import rasterizer
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.leaf import relief
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
        colour = surfaces.leaf_colour(
            coverage, veins, inputs.grids, inputs.texture, surface, px_per_mm, components
        )
    else:
        colour = surfaces.base_colours(surface)[0]
    slopes = None
    if "relief" in components:
        height_mm = relief.leaf_height_map(veins, surface, inputs.grids, px_per_mm, components, size)
        slopes = relief.height_slopes(height_mm, px_per_mm)
    return UnshadedLeaf(coverage, colour, slopes), tf.cast(coverage + 0.5, tf.uint8)


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
