"""The leaf's relief: undulation, quilting between the veins, raised veins (paper, section 3.2)."""

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.filters import blur_and_shift
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.leaf.surface import SurfaceNoiseGrids, SurfaceParams
from laesi_tf.synthesis.ranges import Scalar


def leaf_height_map(
    veins: tf.Tensor | None,
    surface: SurfaceParams[Scalar],
    grids: SurfaceNoiseGrids,
    px_per_mm: tf.Tensor,
    components: tuple[str, ...],
    size: ImageSize,
) -> tf.Tensor:
    """Return the height [H, W] of the leaf's surface in mm.

    Voronoi noise undulates the blade (the paper's vertex displacement), veins are raised, the blade bulges
    between them.
    """
    height = noise.zero_field(size)
    if "undulation" in components:
        voronoi = noise.voronoi_noise(grids.undulation, size, cells=surface.undulation_cells)
        height += voronoi * surface.undulation
    if veins is None:
        return height.values
    bulge = blur_and_shift(veins, size, 1.2 * px_per_mm) * (-1.6 * surface.quilting)
    return (height + bulge).values + 0.12 * veins


def height_slopes(height_mm: tf.Tensor, px_per_mm: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the slopes dH/dx and dH/dy [H, W] of a height map in mm: the normal is (-dH/dx, -dH/dy, 1)."""
    right = tf.pad(height_mm[:, 1:] - height_mm[:, :-1], [[0, 0], [0, 1]])
    below = tf.pad(height_mm[1:] - height_mm[:-1], [[0, 1], [0, 0]])
    return right * px_per_mm, below * px_per_mm
