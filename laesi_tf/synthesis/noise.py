"""Gradient, Voronoi and simple noise, and their weighted sum L (paper, section 3.1).

Every field is a product of small matrices: a grid of random numbers between two interpolation matrices.
Nothing is hashed per pixel, so low-frequency noise costs next to nothing at any image size. Fields are
float32 [H, W], kept as those matrices (`SeparableField`) until they are needed; `cells` is how many grid
cells span the longer side of the image.
"""

from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.geometry import ImageSize

VORONOI_CELLS = 8
_VORONOI_SAMPLES = 4
"""Samples of a Voronoi cell along each axis."""


@dataclass(frozen=True)
class SeparableField:
    """A field as the matrix product of `down` [H, k] and `across` [W, k].

    Fields are added before they are multiplied out, so that a sum of several is one pass over the image.
    """

    down: tf.Tensor
    across: tf.Tensor

    def __add__(self, other: "SeparableField") -> "SeparableField":
        return SeparableField(
            tf.concat([self.down, other.down], axis=1), tf.concat([self.across, other.across], axis=1)
        )

    def __mul__(self, factor: tf.Tensor | float) -> "SeparableField":
        return SeparableField(self.down * factor, self.across)

    @property
    def values(self) -> tf.Tensor:
        """The field [H, W]."""
        return tf.linalg.matmul(self.down, self.across, transpose_b=True)


def zero_field(size: ImageSize) -> SeparableField:
    """Return a field of zeros, to add others to."""
    return SeparableField(tf.zeros([size[0], 1]), tf.zeros([size[1], 1]))


def interpolate_grid(
    grid: tf.Tensor, size: ImageSize, *, cells: tf.Tensor | float | None = None
) -> SeparableField:
    """Interpolate a grid [n, n] smoothly over an image with cubic B-splines.

    `cells` defaults to as many as the grid holds, n - 3, and is never more: a spline reaches one node beyond
    each border.
    """
    nodes = grid.shape[-1]
    cells = nodes - 3 if cells is None else tf.minimum(tf.cast(cells, tf.float32), nodes - 3)
    down, across = (_spline(offsets + 1) for offsets in _offsets(size, nodes, cells))
    return SeparableField(down @ grid, across)


def _offsets(size: ImageSize, nodes: int, cells: tf.Tensor | float) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the offsets [H, nodes] and [W, nodes] of each pixel from each grid node, in cells."""
    pixels = (tf.range(max(size), dtype=tf.float32) + 0.5) * (cells / max(size))
    offsets = pixels[:, None] - tf.range(nodes, dtype=tf.float32)
    return offsets[: size[0]], offsets[: size[1]]


def _spline(offsets: tf.Tensor) -> tf.Tensor:
    """Return the weights of the cubic B-spline: smooth, and without the grid's axes showing."""
    distance = tf.abs(offsets)
    far = tf.maximum(2 - distance, 0)
    near = tf.maximum(1 - distance, 0)
    return far * far * far * (1 / 6) - near * near * near * (4 / 6)


def simple_noise(
    values: tf.Tensor, size: ImageSize, *, cells: tf.Tensor | float | None = None
) -> SeparableField:
    """Return simple (value) noise S: `values` [n, n] uniform in [0, 1), scaled to mean 0 and about [-1, 1].

    The spline averages neighbours, which halves the spread of the values; hence the factor.
    """
    return interpolate_grid(values * 4 - 2, size, cells=cells)


def gradient_noise(
    gradients: tf.Tensor, size: ImageSize, *, cells: tf.Tensor | float | None = None
) -> SeparableField:
    """Return gradient (Perlin) noise G, about [-1, 1] and zero at the nodes, from `gradients` [2, n, n].

    The gradients are in (-1, 1). Perlin's sum over the four corners of fade(x) fade(y) (g . d) is separable,
    hence the matrix products.
    """
    nodes = gradients.shape[-1]
    cells = nodes - 1 if cells is None else tf.minimum(tf.cast(cells, tf.float32), nodes - 1)
    down, across = _offsets(size, nodes, cells)
    down_weights, across_weights = (_fade(tf.maximum(1 - tf.abs(offsets), 0)) for offsets in (down, across))
    along_x = SeparableField(down_weights @ gradients[0], across_weights * across * 1.4)
    along_y = SeparableField((down_weights * down) @ gradients[1], across_weights * 1.4)
    return along_x + along_y


def _fade(x: tf.Tensor) -> tf.Tensor:
    """Return Perlin's quintic 6x^5 - 15x^4 + 10x^3: 0 at 0, 1 at 1, flat to second order at both."""
    return x * x * x * (x * (x * 6 - 15) + 10)


def voronoi_noise(
    jitter: tf.Tensor, size: ImageSize, *, cells: tf.Tensor | float = VORONOI_CELLS
) -> SeparableField:
    """Return Voronoi noise V: distance to the nearest feature point, mean about 0, range about [-1, 1]."""
    span = tf.minimum(tf.cast(cells, tf.float32), VORONOI_CELLS) * _VORONOI_SAMPLES - 3
    return interpolate_grid(voronoi_distance_grid(jitter) * 2 - 0.9, size, cells=span)


def voronoi_distance_grid(jitter: tf.Tensor) -> tf.Tensor:
    """Return the distance to the nearest of 8 x 8 jittered points, 4 samples per cell: [32, 32] in [0, 1.2].

    `jitter` is uniform [2, 10, 10]: the points of one more cell on each side, so that borders are right.
    """
    nodes = VORONOI_CELLS + 2
    neighbours = [
        np.arange(nodes * nodes).reshape(nodes, nodes)[r : r + VORONOI_CELLS, c : c + VORONOI_CELLS]
        for r in range(3)
        for c in range(3)
    ]
    points = tf.gather(tf.reshape(jitter, [2, -1]), np.stack(neighbours), axis=1)
    within = (np.arange(_VORONOI_SAMPLES, dtype=np.float32) + 0.5) / _VORONOI_SAMPLES
    shift = np.arange(3, dtype=np.float32) - 1
    down = points[0][:, :, None, :, None] + (np.repeat(shift, 3)[:, None] - within)[:, None, :, None, None]
    across = points[1][:, :, None, :, None] + (np.tile(shift, 3)[:, None] - within)[:, None, None, None, :]
    side = VORONOI_CELLS * _VORONOI_SAMPLES
    return tf.reshape(tf.sqrt(tf.reduce_min(down * down + across * across, axis=0)), [side, side])


def blend_noises(
    weights: tuple[tf.Tensor, tf.Tensor, tf.Tensor],
    fields: tuple[SeparableField, SeparableField, SeparableField],
) -> SeparableField:
    """Return L = wG G + wV V + wS S (paper, section 3.1)."""
    weighted: list[SeparableField] = [field * weight for field, weight in zip(fields, weights, strict=True)]
    return weighted[0] + weighted[1] + weighted[2]
