"""Draw a prop into an image, within the window that it covers."""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import rasterizer
from laesi_tf.synthesis.geometry import ImageSize, polygon_edges, resample_polygon, subdivide_polygon
from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape
from laesi_tf.synthesis.props.registry import PROPS
from laesi_tf.synthesis.ranges import Scalar

_WINDOW_STEP = 32
_BEND_PIECES = 6
"""Pieces of a shape's edge where lens or bend make it a curve."""
_MANY_POINTS = 64
"""A shape of so many points has edges that are short already."""


class Window(NamedTuple):
    """A rectangle of an image's pixels, int32 scalars."""

    top: tf.Tensor
    left: tf.Tensor
    height: tf.Tensor
    width: tf.Tensor

    @property
    def corner(self) -> tf.Tensor:
        """Top left corner [2] (x, y) in pixels."""
        return tf.cast(tf.stack([self.left, self.top]), tf.float32)

    @property
    def size(self) -> tuple[tf.Tensor, tf.Tensor]:
        """Height and width."""
        return self.height, self.width

    def crop(self, image: tf.Tensor) -> tf.Tensor:
        """Return the window's part of an image [3, H, W]."""
        return tf.slice(image, [0, self.top, self.left], [3, self.height, self.width])

    def pad_to_image(self, crop: tf.Tensor, size: ImageSize) -> tf.Tensor:
        """Return an image [3, H, W] of zeros with `crop` [3, h, w] in the window."""
        below, right = size[0] - self.top - self.height, size[1] - self.left - self.width
        padding = [[0, 0], [self.top, below], [self.left, right]]
        return tf.ensure_shape(tf.pad(crop, padding), [3, *size])


class PropRaster(NamedTuple):
    """The k shapes of a prop in the image, the lowest first.

    `window` covers all of them, `contributions` are those of their edges, each shape in its own layer,
    `colours` are [k, 3, 1, 1] and `opacities` [k].
    """

    window: Window
    contributions: rasterizer.EdgeContributions
    colours: tf.Tensor
    opacities: tf.Tensor


def round_up_side(size: ImageSize) -> int:
    """Return the side for which props of an image of `size` are compiled: a power of two, at least 256.

    Compiling takes half a second per prop; sizes that share a power of two share it.
    """
    return max(256, 1 << math.ceil(math.log2(max(size))))


def rasterise_prop(
    name: str,
    params: PropParams[Scalar],
    largest: PropParams[float],
    context: PropContext,
    numbers: tf.Tensor,
    max_side: int,
    closest_mm: float,
) -> PropRaster:
    """Place prop `name` and compute the contributions of its edges.

    `largest` are the upper ends of the parameters' ranges, `numbers` [n] are uniform in [0, 1), `max_side`
    bounds the image's sides in pixels, and `closest_mm` from below what they show of the sheet.
    """
    shapes = PROPS[name].make(params, largest, context, numbers)
    edges = [_shape_edges(shape, context, max_side / closest_mm) for shape in shapes]
    layers = np.repeat(np.arange(len(shapes), dtype=np.int32), [polygon.shape[0] for polygon in edges])
    together = tf.concat(edges, axis=0)
    corners = together[:, 0]
    window = _window_around(
        tf.reduce_min(corners, axis=0), tf.reduce_max(corners, axis=0) + 1, context.image_wh
    )
    return PropRaster(
        window=window,
        contributions=rasterizer.edge_contributions(
            together - window.corner, window.size, layers=tf.constant(layers)
        ),
        colours=tf.stack([shape.colour for shape in shapes]),
        opacities=tf.stack([shape.opacity for shape in shapes]),
    )


def _shape_edges(shape: PropShape, context: PropContext, max_px_per_mm: float) -> tf.Tensor:
    """Return the edges [n, 2 ends, 2] of `shape` in pixels, short enough for the rasterizer."""
    count = math.ceil(shape.max_perimeter_mm * max_px_per_mm)
    points = shape.points
    if context.view.distortion is not None and points.shape[0] < _MANY_POINTS:
        # Straight edges bend in the photo.
        points = subdivide_polygon(points, _BEND_PIECES)
    return polygon_edges(resample_polygon(context.view.to_photo(points), count))


def _window_around(low: tf.Tensor, high: tf.Tensor, image_wh: tf.Tensor) -> Window:
    """Return the window around the box from `low` [2] to `high` [2], (x, y) in pixels.

    `image_wh` [2] is the image's width and height in pixels. The window's sides are multiples of 32 where the
    image is large enough: libraries that compile a kernel for each shape then meet few shapes.
    """
    sides = tf.cast(image_wh, tf.int32)
    corner = tf.clip_by_value(tf.cast(tf.floor(low), tf.int32), 0, sides - 1)
    extent = tf.maximum(tf.cast(tf.math.ceil(high), tf.int32) - corner, 1)
    extent = tf.minimum((extent + _WINDOW_STEP - 1) // _WINDOW_STEP * _WINDOW_STEP, sides)
    left, top = tf.unstack(tf.minimum(corner, sides - extent))
    width, height = tf.unstack(extent)
    return Window(top, left, height, width)


def composite_prop(image: tf.Tensor, raster: PropRaster, size: ImageSize) -> tf.Tensor:
    """Composite a prop over [3, H, W]."""
    window, count = raster.window, raster.colours.shape[0]
    before = crop = window.crop(image)
    sums = rasterizer.sum_contributions(raster.contributions, window.size, layers=count)
    coverage = rasterizer.union_coverage(rasterizer.integrate_coverage(sums, window.size, layers=count))
    for layer in range(count):
        crop += raster.opacities[layer] * coverage[layer] * (raster.colours[layer] - crop)
    return image + window.pad_to_image(crop - before, size)
