"""The sampled parameters of one synthetic image, and the ranges from which they are sampled."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import tensorflow as tf

from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.leaf.params import LEAF_KINDS, LeafParams
from laesi_tf.synthesis.leaf.surface import SurfaceParams
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.paper.desk import DeskParams
from laesi_tf.synthesis.paper.kinds import crossed_periods_mm
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.props.registry import PROPS, PropsParams, SampledProp, sample_prop
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import (
    Probability,
    Range,
    Scalar,
    choose,
    field_count,
    fields_of,
    sample_params,
    sample_params_of_kind,
    smallest,
)
from laesi_tf.synthesis.scene_numbers import (
    LightNumbers,
    SceneNumbers,
    sample_light_numbers,
    sample_scene_numbers,
)

COMPONENTS = (
    "lens",
    "bend",
    "paper_noise",
    "crease",
    "ruling",
    "paper_kinds",
    "desk",
    "desk_kinds",
    "cut_sheet",
    "empty_sheet",
    *(name for name, prop in PROPS.items() if not prop.covers_leaf),
    "shadow",
    "surface",
    "browned_margin",
    "pale_margin",
    "spots",
    "veins",
    "red_petiole",
    "undulation",
    "relief",
    *(name for name, prop in PROPS.items() if prop.covers_leaf),
    "illumination",
    "photographer",
    "glass",
    "glare",
    "development",
    "focus",
    "sensor_noise",
    "sharpening",
    "chroma_softness",
    "resizing",
    "jpeg",
)
"""What an image consists of beside leaf and sheet, in compositing order; each can be left out by name."""


_SWITCHES = {
    "paper_kinds": ("paper", ("kind", "dotted")),
    "desk_kinds": ("desk", ("kind",)),
    "pale_margin": ("surface", ("margin_pale",)),
    "red_petiole": ("surface", ("petiole_red",)),
    "photographer": ("light", ("photographer",)),
    "glare": ("light", ("glare",)),
    "cut_sheet": ("paper", ("cut", "scrap")),
    "empty_sheet": ("paper", ("empty",)),
    "lens": ("camera", ("distorted",)),
    "bend": ("camera", ("bent",)),
    "sharpening": ("camera", ("sharpened",)),
    "resizing": ("camera", ("resized",)),
    "jpeg": ("camera", ("is_jpeg",)),
}
"""Components that the paper's presets lack: part and fields whose defaults switch a component off."""

PARTS = ("paper", "surface", "light", "props", "camera", "desk")
"""Fields of Ranges that hold one parameter class each; the leaf has one for each kind."""


@dataclasses.dataclass(frozen=True)
class Ranges:
    """The ranges from which scenes are sampled. The defaults are preset `rendering_2`."""

    paper: PaperParams[Range] = PaperParams()
    leaf: Mapping[str, tuple[float, LeafParams[Range]]] = dataclasses.field(
        default_factory=lambda: LEAF_KINDS
    )
    """Kinds of leaf by name, each with its relative frequency."""
    surface: SurfaceParams[Range] = SurfaceParams()
    light: LightParams[Range] = LightParams()
    props: PropsParams[Range] = PropsParams()
    camera: CameraParams[Range] = CameraParams()
    desk: DeskParams[Range] = DeskParams()
    lighting_passes: int = 4
    """Consecutive images that show the same leaf and scene under other light (paper, "Rendering")."""
    without: frozenset[str] = frozenset()
    """Components that are left out of every image, names from COMPONENTS."""

    def has(self, component: str) -> bool:
        """Return whether images may contain `component`."""
        is_never_present = getattr(self.props, component, None) == Probability(0.0)
        if component in _SWITCHES:
            part, defaults = _switched_off(component)
            fields = fields_of(getattr(self, part))
            is_never_present = all(fields[name] == default for name, default in defaults.items())
        return component not in self.without and not is_never_present

    def list_enabled_components(self) -> tuple[str, ...]:
        """Return the components that images may contain, in compositing order."""
        return tuple(name for name in COMPONENTS if self.has(name))

    def switch_off_left_out(self) -> "Ranges":
        """Return ranges whose fields say what `without` says, so that a scene's parameters are true."""
        ranges = self
        for component in sorted(self.without & set(_SWITCHES)):
            part, defaults = _switched_off(component)
            ranges = dataclasses.replace(
                ranges, **{part: dataclasses.replace(getattr(ranges, part), **defaults)}
            )
        return ranges

    def without_empty_sheets(self) -> "Ranges":
        """Return the same ranges with a leaf in every image."""
        if not self.has("empty_sheet"):
            return self
        return dataclasses.replace(self, without=self.without | {"empty_sheet"})

    def with_passes(self, passes: int) -> "Ranges":
        """Return the same ranges with another number of lighting passes per leaf."""
        return dataclasses.replace(self, lighting_passes=passes)


def _switched_off(component: str) -> tuple[str, dict[str, Range]]:
    """Return the part of Ranges that holds `component`, and the fields' values that switch it off."""
    part, names = _SWITCHES[component]
    defaults = fields_of(getattr(Ranges(), part))
    return part, {name: defaults[name] for name in names}


@dataclasses.dataclass(frozen=True)
class Scene:
    """The sampled parameters and random numbers of one image, which is a pure function of them."""

    components: tuple[str, ...]
    """Names of the components that images of these ranges may contain, in compositing order."""
    kind: tf.Tensor
    """Kind of the leaf, int32 []: its position in `Ranges.leaf`."""
    leaf: LeafParams[Scalar]
    surface: SurfaceParams[Scalar]
    paper: PaperParams[Scalar]
    desk: DeskParams[Scalar]
    props: Mapping[str, SampledProp]
    """Those that the ranges allow, by name."""
    camera: CameraParams[Scalar]
    light: LightParams[Scalar]
    numbers: SceneNumbers
    light_numbers: LightNumbers
    """Those of light and sensor: lighting passes over one leaf differ in `light` and in these."""
    closest_mm: float
    """Width of the closest view of these ranges: shapes need as many edges as it has pixels."""

    @property
    def printed_periods_mm(self) -> tf.Tensor:
        """Periods in mm of fine, medium and heavy lines or dots, float32 [3]; 0 unless printed both ways."""
        return crossed_periods_mm(self.paper) if "ruling" in self.components else tf.zeros([3])


def sample_scene(seed: tf.Tensor | int, index: tf.Tensor | int, ranges: Ranges) -> Scene:
    """Sample the scene of image (`seed`, `index`), integer scalars below 2^58.

    Each part is sampled from its own random stream, so that a change of one part leaves the others as they
    were.
    """
    index = tf.cast(index, tf.int64)
    ranges = ranges.switch_off_left_out()
    components = ranges.list_enabled_components()
    streams = RandomStreams(seed, index // ranges.lighting_passes)
    weights, kinds = zip(*ranges.leaf.values(), strict=True)
    kind = choose(weights, streams.uniform([], Stream.LEAF_KIND))
    leaf_numbers = streams.uniform([field_count(kinds[0])], Stream.LEAF)
    light, light_numbers = _sample_light(seed, index, ranges)
    numbers = sample_scene_numbers(streams)
    return Scene(
        components=components,
        kind=kind,
        leaf=sample_params_of_kind(kinds, kind, leaf_numbers),
        surface=_sample_part(ranges.surface, streams, Stream.SURFACE),
        paper=_sample_part(ranges.paper, streams, Stream.PAPER),
        desk=_sample_part(ranges.desk, streams, Stream.DESK),
        props={name: sample_prop(name, ranges.props, streams) for name in PROPS if ranges.has(name)},
        camera=_sample_part(ranges.camera, streams, Stream.CAMERA),
        light=light,
        numbers=numbers,
        light_numbers=light_numbers,
        closest_mm=smallest(ranges.camera.closest_mm),
    )


def sample_lighting_passes(seed: tf.Tensor | int, first: tf.Tensor | int, ranges: Ranges) -> list[Scene]:
    """Sample the scenes of all lighting passes over one leaf; `first` is the index of the first pass."""
    scene = sample_scene(seed, first, ranges)
    others = [_sample_light(seed, first + number, ranges) for number in range(1, ranges.lighting_passes)]
    return [
        scene,
        *(dataclasses.replace(scene, light=light, light_numbers=numbers) for light, numbers in others),
    ]


def _sample_part(ranges: Any, streams: RandomStreams, stream: Stream) -> Any:
    return sample_params(ranges, streams.uniform([field_count(ranges)], stream))


def _sample_light(
    seed: tf.Tensor | int, index: tf.Tensor, ranges: Ranges
) -> tuple[LightParams[Scalar], LightNumbers]:
    streams = RandomStreams(seed, index)
    return _sample_part(ranges.light, streams, Stream.LIGHT), sample_light_numbers(streams)
