"""The sampled parameters of one synthetic image, and the ranges they are sampled from."""

import dataclasses
from collections.abc import Mapping

import tensorflow as tf

from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.leaf import params
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.leaf.surface import SurfaceParams
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.paper.desk import DeskParams
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.props import drawing
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Probability, field_count, sample_params, sample_params_of_kind

COMPONENTS = (
    "ruling",
    "paper_noise",
    "crease",
    "desk",
    *drawing.PROPS,
    "shadow",
    "surface",
    "browned_margin",
    "spots",
    "undulation",
    "veins",
    "relief",
    "illumination",
    "glass",
    "development",
    "focus",
    "sensor_noise",
    "chroma_softness",
)
"""What a picture is made of beside leaf and sheet, in order; each can be left out by name."""


@dataclasses.dataclass(frozen=True)
class Ranges:
    """Where the numbers of a scene come from. The defaults are preset `rendering_2`."""

    paper: PaperParams = PaperParams()
    leaf: Mapping[str, tuple[float, LeafParams]] = dataclasses.field(
        default_factory=lambda: params.LEAF_KINDS
    )
    surface: SurfaceParams = SurfaceParams()
    light: LightParams = LightParams()
    props: PropsParams = PropsParams()
    camera: CameraParams = CameraParams()
    desk: DeskParams = DeskParams()
    lighting_passes: int = 4
    """Consecutive pictures that show the same leaf and scene under other light (paper, "Rendering")."""
    without: frozenset[str] = frozenset()
    """Components that are left out of every picture, names from COMPONENTS."""

    def has(self, component: str) -> bool:
        """Whether pictures may contain `component`."""
        never = getattr(self.props, component, None) == Probability(0.0)
        return component not in self.without and not never

    def with_passes(self, passes: int) -> "Ranges":
        """The same ranges with another number of lighting passes over one leaf."""
        return dataclasses.replace(self, lighting_passes=passes)


@dataclasses.dataclass(frozen=True)
class Scene:
    """The numbers of one picture: scalar tensors, and the keys of its random fields.

    `kind` counts the kinds of leaves in the ranges' order.
    """

    kind: tf.Tensor
    paper: PaperParams
    leaf: LeafParams
    surface: SurfaceParams
    light: LightParams
    props: PropsParams
    camera: CameraParams
    desk: DeskParams
    key: RandomStreams
    light_key: RandomStreams


def sample_scene(seed: tf.Tensor | int, index: tf.Tensor | int, ranges: Ranges) -> Scene:
    """Draw the scene of picture (`seed`, `index`), each an integer scalar below 2^58."""
    index = tf.cast(index, tf.int64)
    key = RandomStreams(seed, index // ranges.lighting_passes)
    rooms = {name: getattr(ranges, name) for name in ("paper", "surface", "props", "camera", "desk")}
    kinds = [kind for _, kind in ranges.leaf.values()]
    sizes = [1, field_count(kinds[0]), *(field_count(room) for room in rooms.values())]
    which, leaf_numbers, *others = tf.split(key.uniform([sum(sizes)], Stream.SCENE), sizes)
    drawn = {
        name: sample_params(room, part) for (name, room), part in zip(rooms.items(), others, strict=True)
    }
    kind = _choose_kind([weight for weight, _ in ranges.leaf.values()], which[0])
    light_key, lit = _sample_light(seed, index, ranges)
    return Scene(
        kind=kind,
        leaf=sample_params_of_kind(kinds, kind, leaf_numbers),
        light=lit,
        key=key,
        light_key=light_key,
        **drawn,
    )


def sample_lighting_passes(seed: tf.Tensor | int, first: tf.Tensor | int, ranges: Ranges) -> list[Scene]:
    """The scenes of all lighting passes over one leaf, of which `first` is the index of the first."""
    scene = sample_scene(seed, first, ranges)
    others = [_sample_light(seed, first + number, ranges) for number in range(1, ranges.lighting_passes)]
    return [scene, *(dataclasses.replace(scene, light_key=key, light=lit) for key, lit in others)]


def _sample_light(
    seed: tf.Tensor | int, index: tf.Tensor, ranges: Ranges
) -> tuple[RandomStreams, LightParams]:
    key = RandomStreams(seed, index)
    return key, sample_params(ranges.light, key.uniform([field_count(ranges.light)], Stream.LIGHT))


def _choose_kind(weights: list[float], uniform: tf.Tensor) -> tf.Tensor:
    """Index of the weight that `uniform` in [0, 1) falls on."""
    steps = tf.cumsum(tf.constant(weights, tf.float32) / sum(weights))
    return tf.minimum(tf.reduce_sum(tf.cast(uniform >= steps, tf.int32)), len(weights) - 1)
