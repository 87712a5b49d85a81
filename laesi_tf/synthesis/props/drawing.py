"""Draw a prop into an image, within the window that it covers."""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import rasterizer
from laesi_tf.synthesis.geometry import ImageSize, project_points
from laesi_tf.synthesis.polygons import polygon_edges, resample_polygon
from laesi_tf.synthesis.props.placement import PropContext, PropParams, PropShape
from laesi_tf.synthesis.props.registry import PROPS
from laesi_tf.synthesis.ranges import Scalar
from laesi_tf.synthesis.windows import Window, window_around


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
) -> PropRaster:
    """Place prop `name` and compute the contributions of its edges.

    `largest` are the upper ends of the parameters' ranges, `numbers` [n] are uniform in [0, 1), `max_side`
    bounds the image's sides in pixels.
    """
    shapes = PROPS[name].make(params, largest, context, numbers)
    edges = [_shape_edges(shape, context, max_side) for shape in shapes]
    layers = np.repeat(np.arange(len(shapes), dtype=np.int32), [polygon.shape[0] for polygon in edges])
    together = tf.concat(edges, axis=0)
    corners = together[:, 0]
    window = window_around(
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


def _shape_edges(shape: PropShape, context: PropContext, max_side: int) -> tf.Tensor:
    """Return the edges [n, 2 ends, 2] of `shape` in pixels, short enough for the rasterizer."""
    count = math.ceil(shape.max_perimeter_mm * max_side / 70)
    return polygon_edges(resample_polygon(project_points(context.to_px, shape.points), count))


def composite_prop(image: tf.Tensor, raster: PropRaster, size: ImageSize) -> tf.Tensor:
    """Composite a prop over [3, H, W]."""
    window, count = raster.window, raster.colours.shape[0]
    sums = rasterizer.sum_contributions(raster.contributions, window.size, layers=count)
    coverage = rasterizer.union_coverage(rasterizer.integrate_coverage(sums, window.size, layers=count))
    before = crop = window.crop(image)
    for layer in range(count):
        crop += raster.opacities[layer] * coverage[layer] * (raster.colours[layer] - crop)
    return image + window.pad_to_image(crop - before, size)
