"""Gradient, Voronoi and simple noise, and their weighted sum L (paper, section 3.1).

Every field is a product of small matrices: a random lattice between two interpolation matrices. Nothing
is hashed per pixel, so low-frequency noise costs next to nothing at any picture size.
Fields are float32 [H, W]; `cells` is how many lattice cells span the longer side of the picture.
"""

import functools

import numpy as np
import tensorflow as tf

Size = tuple[int, int]


def _fade(x: tf.Tensor) -> tf.Tensor:
    """Perlin's quintic 6x^5 - 15x^4 + 10x^3: 0 at 0, 1 at 1, flat to second order at both."""
    return x * x * x * (x * (x * 6 - 15) + 10)


def _positions(length: int, longest: int, lattice: int, cells: tf.Tensor | float) -> tf.Tensor:
    """Offsets [length, lattice] of each pixel from each lattice node, in cells."""
    pixels = (tf.range(length, dtype=tf.float32) + 0.5) * (cells / longest)
    return pixels[:, None] - tf.range(lattice, dtype=tf.float32)[None, :]


def _spline(offsets: tf.Tensor) -> tf.Tensor:
    """Weights of the cubic B-spline, normalised where the lattice ends: smooth and free of the lattice's axes."""
    distance = tf.abs(offsets)
    far = tf.maximum(2 - distance, 0)
    near = tf.maximum(1 - distance, 0)
    weights = (far * far * far - 4 * near * near * near) / 6
    return weights / tf.reduce_sum(weights, axis=1, keepdims=True)


def upsample(lattice: tf.Tensor, size: Size, *, cells: tf.Tensor | float | None = None) -> tf.Tensor:
    """Interpolate a lattice [..., n, m] smoothly over a picture: [..., H, W].

    `cells` defaults to the whole lattice; it must not exceed n - 1 (a lattice is never extrapolated).
    """
    rows, columns = lattice.shape[-2:]
    cells = min(rows, columns) - 1 if cells is None else cells
    across = _spline(_positions(size[1], max(size), columns, cells))
    down = _spline(_positions(size[0], max(size), rows, cells))
    return down @ lattice @ tf.transpose(across)


def simple(values: tf.Tensor, size: Size, *, cells: tf.Tensor | float | None = None) -> tf.Tensor:
    """Simple (value) noise S: `values` [n, n] uniform in [0, 1), scaled to mean 0 and about [-1, 1].

    The spline averages neighbours, which halves the values' spread; hence the factor.
    """
    return upsample(values * 4 - 2, size, cells=cells)


def gradient(gradients: tf.Tensor, size: Size, *, cells: tf.Tensor | float | None = None) -> tf.Tensor:
    """Gradient (Perlin) noise G from `gradients` [2, n, n] in (-1, 1): about [-1, 1], zero at the nodes.

    Perlin's sum over the four corners of fade(x) fade(y) (g . d) is separable, hence four matrix products.
    """
    nodes = gradients.shape[-1]
    cells = nodes - 1 if cells is None else cells
    across, down = (_positions(side, max(size), nodes, cells) for side in (size[1], size[0]))
    across_weights, down_weights = (_fade(tf.maximum(1 - tf.abs(offsets), 0)) for offsets in (across, down))
    along_x = down_weights @ gradients[0] @ tf.transpose(across_weights * across)
    along_y = (down_weights * down) @ gradients[1] @ tf.transpose(across_weights)
    return (along_x + along_y) * 1.4


VORONOI_CELLS = 8
_SAMPLES = 6


def voronoi_lattice(jitter: tf.Tensor) -> tf.Tensor:
    """Distance to the nearest of 8 x 8 jittered points, sampled 6 times a cell: [48, 48] in [0, 1.2].

    `jitter` is uniform [2, 10, 10]: the points of one more cell on each side, so that borders are right.
    """
    within = (np.arange(_SAMPLES, dtype=np.float32) + 0.5) / _SAMPLES
    squared = []
    for row in range(3):
        for column in range(3):
            points = jitter[:, row : row + VORONOI_CELLS, column : column + VORONOI_CELLS]
            down = points[0][:, None, :, None] + (row - 1 - within)[None, :, None, None]
            across = points[1][:, None, :, None] + (column - 1 - within)[None, None, None, :]
            squared.append(down * down + across * across)
    side = VORONOI_CELLS * _SAMPLES
    return tf.reshape(tf.sqrt(tf.reduce_min(tf.stack(squared), axis=0)), [side, side])


def voronoi(jitter: tf.Tensor, size: Size, *, cells: tf.Tensor | float = VORONOI_CELLS) -> tf.Tensor:
    """Voronoi noise V: distance to the nearest feature point, mean about 0, range about [-1, 1]."""
    span = tf.minimum(tf.cast(cells, tf.float32), VORONOI_CELLS) * _SAMPLES - 1
    return upsample(voronoi_lattice(jitter) * 2 - 0.9, size, cells=span)


def blend(
    weights: tuple[tf.Tensor, tf.Tensor, tf.Tensor], fields: tuple[tf.Tensor, tf.Tensor, tf.Tensor]
) -> tf.Tensor:
    """L = wG G + wV V + wS S (paper, section 3.1): [H, W]."""
    return weights[0] * fields[0] + weights[1] * fields[1] + weights[2] * fields[2]


@functools.cache
def _grain_bank(side: int) -> np.ndarray:
    return np.random.default_rng(20240400593).standard_normal((side, side)).astype(np.float32)


def grain(offsets: tf.Tensor, size: Size) -> tf.Tensor:
    """White normal noise [n, H, W], cut at uniform `offsets` [n, 2] in [0, 1) from one fixed bank.

    Drawing 150,000 fresh normals costs more than the rest of the camera; a random window of a bank 96 pixels
    wider than the picture looks the same to anything that sees one picture at a time.
    """
    slack = 96
    bank = tf.constant(_grain_bank(max(size) + slack))
    corners = tf.cast(offsets * slack, tf.int32)
    cuts = [tf.slice(bank, corner, size) for corner in tf.unstack(corners)]
    return tf.stack(cuts)
