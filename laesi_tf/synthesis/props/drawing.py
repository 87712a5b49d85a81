"""Draw props into an image, from flat to high (paper, "Scene Composition")."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import geometry, polygons, rasterizer
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.props.calibration_square import make_calibration_square
from laesi_tf.synthesis.props.coin import make_coin
from laesi_tf.synthesis.props.fragment import make_fragment
from laesi_tf.synthesis.props.handwriting import make_handwriting
from laesi_tf.synthesis.props.label import make_label
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.pen import make_pen
from laesi_tf.synthesis.props.placement import PropContext, PropShape
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.windows import Window, window_around
from laesi_tf.synthesis.xla import compile_with_xla


class PropRaster(NamedTuple):
    """The k items of a prop in the picture, the lowest first: the window around them, what their edges leave
    in it, each item in its own layer, and their colours [k, 3, 1, 1] and opacities [k]."""

    around: Window
    left: rasterizer.EdgeContributions
    colours: tf.Tensor
    opacities: tf.Tensor


def _rasterise_prop(name: str, props: PropsParams, stage: PropContext, random: tf.Tensor) -> PropRaster:
    """Prop `name` in a picture of the stage's size."""
    # Compiling takes half a second a prop: sizes that share a power of two share what is compiled.
    side = max(256, 2 ** math.ceil(math.log2(max(stage.size))))
    frame = tf.constant(stage.size[::-1], tf.float32)
    return _rasterise_within(name, props, stage._replace(size=(side, side), frame=frame), random)


@compile_with_xla
def _rasterise_within(name: str, props: PropsParams, stage: PropContext, random: tf.Tensor) -> PropRaster:
    """`_drawn`, compiled for the stage's size."""
    items = PROPS[name](props, stage, random)
    edges = [_prop_edges(item, stage) for item in items]
    layers = np.repeat(np.arange(len(items), dtype=np.int32), [polygon.shape[0] for polygon in edges])
    together = tf.concat(edges, axis=0)
    corners = together[:, 0]
    around = window_around(tf.reduce_min(corners, axis=0), tf.reduce_max(corners, axis=0) + 1, stage.frame)
    return PropRaster(
        around=around,
        left=rasterizer.edge_contributions(together - around.corner, around.size, layers=tf.constant(layers)),
        colours=tf.stack([item.colour for item in items]),
        opacities=tf.stack([item.opacity for item in items]),
    )


def _prop_edges(item: PropShape, stage: PropContext) -> tf.Tensor:
    """Edges of `item` in pixels, short enough to be filled in a picture of the stage's size."""
    count = math.ceil(item.perimeter_mm * max(stage.size) / 70)
    return polygons.polygon_edges(
        polygons.resample_polygon(geometry.project_points(stage.view.to_px, item.points), count)
    )


def _composite_prop(image: tf.Tensor, drawn: PropRaster, size: ImageSize) -> tf.Tensor:
    """Lay a prop over [3, H, W], within the window that it covers."""
    around, count = drawn.around, drawn.colours.shape[0]
    heights = rasterizer.sum_contributions(drawn.left, around.size, layers=count)
    covers = rasterizer.union_coverage(rasterizer.integrate_coverage(heights, around.size, layers=count))
    before = part = around.cut(image)
    for layer in range(count):
        part += drawn.opacities[layer] * covers[layer] * (drawn.colours[layer] - part)
    return image + around.paste(part - before, size)


PROPS: dict[str, Callable[[PropsParams, PropContext, tf.Tensor], list[PropShape]]] = {
    "handwriting": make_handwriting,
    "fragment": make_fragment,
    "label": make_label,
    "coin": make_coin,
    "pen": make_pen,
    "calibration": make_calibration_square,
}
"""From flat to high, the order in which they are laid down, but for the square, which nothing may hide; each
is present by the number of its name and returns its items, the lowest first. New ones go to the end: the
random numbers of those before them then stay what they were."""


def draw_props(
    image: tf.Tensor, props: PropsParams, stage: PropContext, key: RandomStreams, names: list[str]
) -> tf.Tensor:
    """Lay the props in `names` that the scene has onto [3, H, W]."""
    random = key.uniform([len(PROPS), 80], Stream.PROPS)
    for row, name in enumerate(PROPS):
        if name in names:
            image = tf.cond(
                getattr(props, name),
                lambda image=image, name=name, row=row: _composite_prop(
                    image, _rasterise_prop(name, props, stage, random[row]), stage.size
                ),
                lambda image=image: image,
            )
    return image
