"""The random numbers from which the shapes and noise fields of a scene are computed."""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis.leaf.holes import HOLES
from laesi_tf.synthesis.leaf.outline import BITES, CONTROLS, ROUGHNESS_NODES, OutlineNumbers
from laesi_tf.synthesis.leaf.surface import BLEND_NODES, FINE_NODES, SurfaceNoiseGrids
from laesi_tf.synthesis.leaf.veins import MAX_SECONDARY_VEINS, SECONDARY_STEPS
from laesi_tf.synthesis.light import UNEVENNESS_NODES
from laesi_tf.synthesis.noise import VORONOI_CELLS
from laesi_tf.synthesis.paper.desk import GRAIN_NODES
from laesi_tf.synthesis.paper.sheet import GRADIENT_NODES, SIMPLE_NODES, SheetNoiseGrids
from laesi_tf.synthesis.random_streams import RandomStreams, Stream

_VORONOI_NODES = VORONOI_CELLS + 2


class SceneNumbers(NamedTuple):
    """Numbers that lighting passes over one leaf share.

    `holes` [HOLES, 8], `texture` [4] and `desk` [n, n] are uniform in [0, 1), `turtles` [2,
    MAX_SECONDARY_VEINS, SECONDARY_STEPS + 2] are standard normal.
    """

    outline: OutlineNumbers
    holes: tf.Tensor
    turtles: tf.Tensor
    surface: SurfaceNoiseGrids
    texture: tf.Tensor
    sheet: SheetNoiseGrids
    desk: tf.Tensor


class LightNumbers(NamedTuple):
    """Uniform numbers of one lighting pass: of uneven `illumination` [n, n] and of `sensor` noise [2]."""

    illumination: tf.Tensor
    sensor: tf.Tensor


def sample_scene_numbers(streams: RandomStreams) -> SceneNumbers:
    """Sample the numbers of one scene."""
    return SceneNumbers(
        outline=OutlineNumbers(
            normals=streams.normal([2, CONTROLS + 2 * ROUGHNESS_NODES, 2], Stream.OUTLINE),
            bites=streams.uniform([2, BITES, 3], Stream.BITES),
        ),
        holes=streams.uniform([HOLES, 8], Stream.HOLES),
        turtles=streams.normal([2, MAX_SECONDARY_VEINS, SECONDARY_STEPS + 2], Stream.VEINS),
        surface=SurfaceNoiseGrids(
            blend=streams.uniform([2, BLEND_NODES, BLEND_NODES], Stream.SURFACE_BLEND),
            mottle=streams.uniform([FINE_NODES, FINE_NODES], Stream.SURFACE_MOTTLE),
            spots=streams.uniform([FINE_NODES, FINE_NODES], Stream.SURFACE_SPOTS),
            undulation=streams.uniform([2, _VORONOI_NODES, _VORONOI_NODES], Stream.SURFACE_UNDULATION),
        ),
        texture=streams.uniform([4], Stream.TEXTURE),
        sheet=SheetNoiseGrids(
            gradients=streams.uniform([2, GRADIENT_NODES, GRADIENT_NODES], Stream.PAPER_GRADIENT),
            values=streams.uniform([2, SIMPLE_NODES, SIMPLE_NODES], Stream.PAPER_SIMPLE),
            jitter=streams.uniform([2, _VORONOI_NODES, _VORONOI_NODES], Stream.PAPER_VORONOI),
        ),
        desk=streams.uniform([GRAIN_NODES, GRAIN_NODES], Stream.DESK_GRAIN),
    )


def sample_light_numbers(streams: RandomStreams) -> LightNumbers:
    """Sample the numbers of one lighting pass."""
    return LightNumbers(
        illumination=streams.uniform([UNEVENNESS_NODES, UNEVENNESS_NODES], Stream.ILLUMINATION),
        sensor=streams.uniform([2], Stream.SENSOR),
    )
