"""A picture is a pure function of a few dozen numbers: `sample` draws them, `render` makes the picture."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import camera, desk, light, noise, paper, pixels, props, raster, surface, veins
from laesi_tf.synthesis import leaf as leaves
from laesi_tf.synthesis.camera import Camera, View
from laesi_tf.synthesis.desk import Desk
from laesi_tf.synthesis.frame import Size
from laesi_tf.synthesis.fusing import fused
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.leaf import Leaf
from laesi_tf.synthesis.light import Light
from laesi_tf.synthesis.paper import Paper
from laesi_tf.synthesis.pixels import Parts
from laesi_tf.synthesis.props import Props
from laesi_tf.synthesis.ranges import Chance, count, draw, draw_one_of
from laesi_tf.synthesis.surface import Surface

COMPONENTS = (
    "ruling",
    "paper_noise",
    "crease",
    "desk",
    *props.PROPS,
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

    paper: Paper = Paper()
    leaf: Mapping[str, tuple[float, Leaf]] = dataclasses.field(default_factory=lambda: leaves.KINDS)
    surface: Surface = Surface()
    light: Light = Light()
    props: Props = Props()
    camera: Camera = Camera()
    desk: Desk = Desk()
    lighting_passes: int = 4
    """Consecutive pictures that show the same leaf and scene under other light (paper, "Rendering")."""
    without: frozenset[str] = frozenset()
    """Components that are left out of every picture, names from COMPONENTS."""

    def has(self, component: str) -> bool:
        """Whether pictures may contain `component`."""
        never = getattr(self.props, component, None) == Chance(0.0)
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
    paper: Paper
    leaf: Leaf
    surface: Surface
    light: Light
    props: Props
    camera: Camera
    desk: Desk
    key: Key
    light_key: Key


def sample(seed: tf.Tensor | int, index: tf.Tensor | int, ranges: Ranges) -> Scene:
    """Draw the scene of picture (`seed`, `index`), each an integer scalar below 2^58."""
    index = tf.cast(index, tf.int64)
    key = Key(seed, index // ranges.lighting_passes)
    rooms = {name: getattr(ranges, name) for name in ("paper", "surface", "props", "camera", "desk")}
    kinds = [kind for _, kind in ranges.leaf.values()]
    sizes = [1, count(kinds[0]), *(count(room) for room in rooms.values())]
    which, leaf_numbers, *others = tf.split(key.uniform([sum(sizes)], Purpose.SCENE), sizes)
    drawn = {name: draw(room, part) for (name, room), part in zip(rooms.items(), others, strict=True)}
    kind = _choose([weight for weight, _ in ranges.leaf.values()], which[0])
    light_key, lit = _lit(seed, index, ranges)
    return Scene(
        kind=kind,
        leaf=draw_one_of(kinds, kind, leaf_numbers),
        light=lit,
        key=key,
        light_key=light_key,
        **drawn,
    )


def sample_passes(seed: tf.Tensor | int, first: tf.Tensor | int, ranges: Ranges) -> list[Scene]:
    """The scenes of all lighting passes over one leaf, of which `first` is the index of the first."""
    scene = sample(seed, first, ranges)
    others = [_lit(seed, first + number, ranges) for number in range(1, ranges.lighting_passes)]
    return [scene, *(dataclasses.replace(scene, light_key=key, light=lit) for key, lit in others)]


def _lit(seed: tf.Tensor | int, index: tf.Tensor, ranges: Ranges) -> tuple[Key, Light]:
    key = Key(seed, index)
    return key, draw(ranges.light, key.uniform([count(ranges.light)], Purpose.LIGHT))


def _choose(weights: list[float], uniform: tf.Tensor) -> tf.Tensor:
    """Index of the weight that `uniform` in [0, 1) falls on."""
    steps = tf.cumsum(tf.constant(weights, tf.float32) / sum(weights))
    return tf.minimum(tf.reduce_sum(tf.cast(uniform >= steps, tf.int32)), len(weights) - 1)


class Pose(NamedTuple):
    """Rotation [2, 2] and translation [2] from leaf coordinates to sheet coordinates, mm."""

    turn: tf.Tensor
    shift: tf.Tensor

    def apply(self, points: tf.Tensor) -> tf.Tensor:
        """Leaf coordinates [..., 2] to sheet coordinates [..., 2]."""
        flat = tf.linalg.matmul(tf.reshape(points, [-1, 2]), self.turn, transpose_b=True) + self.shift
        return tf.reshape(flat, tf.shape(points))


class Geometry(NamedTuple):
    """Where everything is: the leaf's `outline` [n, 2] and `holes` [k, m, 2] in sheet mm, with the leaf's box
    centred on the origin, and the camera's view of them."""

    outline: tf.Tensor
    holes: tf.Tensor
    pose: Pose
    view: View
    area_cm2: tf.Tensor


def geometry(scene: Scene, size: Size) -> Geometry:
    """Lay the leaf on the sheet and point the camera at it."""
    ring, places = leaves.ring(scene.leaf, scene.key), leaves.hole_places(scene.key)
    # The size as a tensor: one compilation serves all sizes, and the label is the same at each.
    return _laid(scene.leaf, scene.camera, ring, places, tf.constant(size, tf.float32))


@fused
def _laid(leaf: Leaf, held: Camera, ring: leaves.Ring, places: tf.Tensor, size: tf.Tensor) -> Geometry:
    """`geometry` of a leaf whose outline is `ring` and whose holes are at `places`."""
    outline, holes = leaves.outline(ring), leaves.holes(leaf, places)
    cosine, sine = tf.cos(leaf.angle), tf.sin(leaf.angle)
    turn = tf.stack([tf.stack([cosine, -sine]), tf.stack([sine, cosine])])
    turned = tf.linalg.matmul(outline, turn, transpose_b=True)
    pose = Pose(turn, -(tf.reduce_min(turned, axis=0) + tf.reduce_max(turned, axis=0)) / 2)
    centred = turned + pose.shift
    return Geometry(
        outline=centred,
        holes=pose.apply(holes),
        pose=pose,
        view=camera.view(held, centred, size),
        area_cm2=leaves.area_cm2(outline, holes),
    )


def leaf_edges(place: Geometry, size: Size) -> tf.Tensor:
    """Edges [n, 2 ends, 2] of the leaf and its holes in pixels."""
    pieces = math.ceil(max(size) / 256)
    polygons = [
        raster.subdivide(camera.project(place.view.to_px, points), pieces)
        for points in (place.outline, place.holes)
    ]
    return tf.concat([tf.reshape(raster.segments(points), [-1, 2, 2]) for points in polygons], axis=0)


def _vein_edges(place: Geometry, leaf: Leaf, skin: Surface, commands: tf.Tensor, size: Size) -> tf.Tensor:
    """Edges [n, 2 ends, 2] of the leaf's veins in pixels."""
    edges = veins.edges(leaf, commands, skin.vein_jitter, skin.vein_width_mm)
    return raster.subdivide_edges(
        camera.project(place.view.to_px, place.pose.apply(edges)), math.ceil(max(size) / 40)
    )


@fused
def _deposits(
    place: Geometry, leaf: Leaf, skin: Surface, commands: tf.Tensor, size: Size, parts: Parts
) -> list[raster.Deposits]:
    """What the edges of the leaf leave in the picture's cells, and what those of its veins do."""
    edges = [leaf_edges(place, size)]
    if "veins" in parts:
        edges.append(_vein_edges(place, leaf, skin, commands, size))
    return [raster.deposits(polygons, size) for polygons in edges]


class Laid(NamedTuple):
    """What lighting passes over one leaf have in common: where everything is, sheet and desk with what lies
    on them [3, H, W], and what the leaf is made of."""

    place: Geometry
    sheet: tf.Tensor
    blade: pixels.Blade


def render(
    scene: Scene, size: Size, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> dict[str, tf.Tensor]:
    """Turn the numbers of a scene into a picture of `size` (height, width).

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's
    centroid) and `tilt_deg` float32 [], `to_px` float32 [3, 3], sheet mm to pixels, and `kind` int32 [],
    which of the ranges' kinds of leaves it is.
    """
    parts = _parts(ranges)
    laid = _lay_out(scene, size, parts, textures)
    image, mask = pixels.with_leaf(
        laid.sheet, laid.blade, scene.surface, scene.light, laid.place.view.px_per_mm, parts
    )
    return _picture(image, mask, scene, laid.place, parts)


def render_passes(
    passes: Sequence[Scene], size: Size, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> list[dict[str, tf.Tensor]]:
    """The pictures, each as `render` makes it, of scenes that differ in their light alone."""
    parts = _parts(ranges)
    laid = _lay_out(passes[0], size, parts, textures)
    px_per_mm = laid.place.view.px_per_mm
    leaf, mask = pixels.unlit(laid.blade, passes[0].surface, px_per_mm, size, parts)
    return [
        _picture(
            pixels.in_light(laid.sheet, leaf, scene.light, px_per_mm, parts), mask, scene, laid.place, parts
        )
        for scene in passes
    ]


def _parts(ranges: Ranges) -> Parts:
    return tuple(name for name in COMPONENTS if ranges.has(name))


def _lay_out(scene: Scene, size: Size, parts: Parts, textures: tf.Tensor | None) -> Laid:
    key, place = scene.key, geometry(scene, size)
    view = place.view
    extent = tf.stack([tf.reduce_min(place.outline, axis=0), tf.reduce_max(place.outline, axis=0)])
    where = pixels.ruled(scene.paper, view.to_px, size) if "ruling" in parts else None
    sheet = pixels.page(
        scene.paper, paper.lattices(key), scene.desk, desk.lattice(key), extent, view, where, size, parts
    )
    stage = props.Stage(leaf=place.outline, view=view, size=size)
    sheet = props.scatter(sheet, scene.props, stage, key, [name for name in props.PROPS if name in parts])
    left = _deposits(place, scene.leaf, scene.surface, veins.commands(key), size, parts)
    texture = None if textures is None else surface.photographed(textures, key, size)
    heights = [raster.summed(deposits, size) for deposits in left]
    return Laid(place, sheet, pixels.Blade(heights, surface.lattices(key), texture))


def _picture(
    image: tf.Tensor, mask: tf.Tensor, scene: Scene, place: Geometry, parts: Parts
) -> dict[str, tf.Tensor]:
    """What `render` returns, of what there is to be seen [3, H, W] and the leaf's mask."""
    light_numbers = light.lattice(scene.light_key)
    exposed = pixels.exposed(image, scene.light, light_numbers, scene.camera, scene.paper, parts)
    return {
        "image": _recorded(exposed, scene, place, parts),
        "mask": mask,
        "area_cm2": place.area_cm2,
        "px_per_mm": place.view.px_per_mm,
        "tilt_deg": scene.camera.tilt_deg * tf.cast(scene.camera.tilted, tf.float32),
        "to_px": place.view.to_px,
        "kind": scene.kind,
    }


def _recorded(image: tf.Tensor, scene: Scene, place: Geometry, parts: Parts) -> tf.Tensor:
    """What lens, sensor and file make of the exposed image [3, H, W]: bytes [H, W, 3]."""
    held, grain = scene.camera, None
    if "focus" in parts:
        image = camera.focus(image, held, place.view.px_per_mm)
    if "sensor_noise" in parts:
        cut = scene.light_key.uniform([2], Purpose.SENSOR)
        grain = noise.grain(cut, (image.shape[1], image.shape[2]))

    def crisp() -> tf.Tensor:
        return pixels.crisp(image, held, grain)

    def compressed() -> tf.Tensor:
        return pixels.compressed(*pixels.softened(image, held, grain))

    return tf.cond(held.compressed, compressed, crisp) if "chroma_softness" in parts else crisp()
