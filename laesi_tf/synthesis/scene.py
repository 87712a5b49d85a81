"""A picture is a pure function of a few dozen numbers: `sample` draws them, `render` makes the picture."""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import camera, desk, light, paper, props, raster, surface, veins
from laesi_tf.synthesis import leaf as leaves
from laesi_tf.synthesis.camera import Camera, View
from laesi_tf.synthesis.desk import Desk
from laesi_tf.synthesis.frame import Size, Window, window
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.leaf import Leaf
from laesi_tf.synthesis.light import Light
from laesi_tf.synthesis.paper import Paper
from laesi_tf.synthesis.props import Props
from laesi_tf.synthesis.ranges import count, draw, draw_one_of
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
        return component not in self.without

    def with_passes(self, passes: int) -> "Ranges":
        """The same ranges with another number of lighting passes over one leaf."""
        return dataclasses.replace(self, lighting_passes=passes)


@dataclasses.dataclass(frozen=True)
class Scene:
    """The numbers of one picture: scalar tensors, and the keys of its random fields."""

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
    key, light_key = Key(seed, index // ranges.lighting_passes), Key(seed, index)
    rooms = {name: getattr(ranges, name) for name in ("paper", "surface", "props", "camera", "desk")}
    kinds = [kind for _, kind in ranges.leaf.values()]
    sizes = [1, count(kinds[0]), *(count(room) for room in rooms.values())]
    which, leaf_numbers, *others = tf.split(key.uniform([sum(sizes)], Purpose.SCENE), sizes)
    drawn = {name: draw(room, part) for (name, room), part in zip(rooms.items(), others, strict=True)}
    return Scene(
        leaf=draw_one_of(
            kinds, _choose([weight for weight, _ in ranges.leaf.values()], which[0]), leaf_numbers
        ),
        light=draw(ranges.light, light_key.uniform([count(ranges.light)], Purpose.LIGHT)),
        key=key,
        light_key=light_key,
        **drawn,
    )


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


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Where everything is: the leaf's `outline` [n, 2] and `holes` [k, m, 2] in sheet mm, with the leaf's box
    centred on the origin, and the camera's view of them."""

    outline: tf.Tensor
    holes: tf.Tensor
    pose: Pose
    view: View
    area_cm2: tf.Tensor


def geometry(scene: Scene, size: Size) -> Geometry:
    """Lay the leaf on the sheet and point the camera at it."""
    outline, holes = leaves.outline(scene.leaf, scene.key), leaves.holes(scene.leaf, scene.key)
    cosine, sine = tf.cos(scene.leaf.angle), tf.sin(scene.leaf.angle)
    turn = tf.stack([tf.stack([cosine, -sine]), tf.stack([sine, cosine])])
    turned = tf.linalg.matmul(outline, turn, transpose_b=True)
    pose = Pose(turn, -(tf.reduce_min(turned, axis=0) + tf.reduce_max(turned, axis=0)) / 2)
    centred = turned + pose.shift
    return Geometry(
        outline=centred,
        holes=pose.apply(holes),
        pose=pose,
        view=camera.view(scene.camera, centred, size),
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


def render(
    scene: Scene, size: Size, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> dict[str, tf.Tensor]:
    """Turn the numbers of a scene into a picture of `size` (height, width).

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's
    centroid) and `tilt_deg` float32 [], and `to_px` float32 [3, 3], sheet mm to pixels.
    """
    place = geometry(scene, size)
    edges = leaf_edges(place, size)
    corners = tf.reshape(edges, [-1, 2])
    leaf_window = window(tf.reduce_min(corners, axis=0), tf.reduce_max(corners, axis=0), size)
    filled = raster.fill(edges - leaf_window.corner, leaf_window.frame)
    # The outline runs clockwise, which fills with -1. Where a margin crosses itself it turns the other way:
    # that is leaf neither for the mask nor for the label.
    inner_coverage = tf.clip_by_value(-filled, 0, 1)
    coverage = leaf_window.paste(inner_coverage, size)
    image = _sheet(scene, place, size, ranges)
    if ranges.has("shadow"):
        image *= light.shadow(coverage, scene.light, size, place.view.px_per_mm)
    blade = _blade(scene, place, inner_coverage, leaf_window, ranges, textures)
    image += leaf_window.paste(inner_coverage * (blade - leaf_window.cut(image)), size)
    image = _photograph(image, scene, place, ranges)
    # Transposing floats and then casting is three times faster than transposing bytes.
    pixels = tf.transpose(tf.clip_by_value(image * 255 + 0.5, 0, 255), [1, 2, 0])
    return {
        "image": tf.cast(pixels, tf.uint8),
        "mask": tf.cast(coverage + 0.5, tf.uint8),
        "area_cm2": place.area_cm2,
        "px_per_mm": place.view.px_per_mm,
        "tilt_deg": scene.camera.tilt_deg * tf.cast(scene.camera.tilted, tf.float32),
        "to_px": place.view.to_px,
    }


def _sheet(scene: Scene, place: Geometry, size: Size, ranges: Ranges) -> tf.Tensor:
    """The sheet on its desk with everything that lies on it but the leaf: [3, H, W]."""
    x, y = camera.sheet_coordinates(place.view.to_px, size)
    view, sheet = place.view, scene.paper
    strength, shade = tf.ones(size), tf.ones(size)
    if ranges.has("paper_noise"):
        blend, strength = paper.wear(sheet, scene.key, size)
        shade += blend
    if ranges.has("crease"):
        shade = tf.cond(sheet.creased, lambda: shade + paper.crease(sheet, x, y, view.fov_mm), lambda: shade)
    bare = paper.colour(sheet) * shade
    inks = tf.zeros([3, 1, 1])
    if ranges.has("ruling"):
        inks = paper.ruling(sheet, x, y, paper.samples_per_mm(size), 1 / view.px_per_mm)

    def on_desk() -> tf.Tensor:
        distance = paper.margin(sheet, place.outline, x, y)
        printed = tf.clip_by_value((distance - sheet.border_mm) * view.px_per_mm + 0.5, 0, 1)
        on_sheet = tf.clip_by_value(distance * view.px_per_mm + 0.5, 0, 1)
        table = desk.desk(scene.desk, scene.key, distance)
        return table + on_sheet * (bare * (1 - (strength * printed) * inks) - table)

    def filling() -> tf.Tensor:
        return bare * (1 - strength * inks)

    image = tf.cond(sheet.edged, on_desk, filling) if ranges.has("desk") else filling()
    stage = props.Stage(leaf=place.outline, view=view, size=size)
    return props.scatter(
        image, scene.props, stage, scene.key, [name for name in props.PROPS if ranges.has(name)]
    )


def _blade(
    scene: Scene,
    place: Geometry,
    coverage: tf.Tensor,
    leaf_window: Window,
    ranges: Ranges,
    textures: tf.Tensor | None,
) -> tf.Tensor:
    """The lit leaf as if it filled the window that it lies in: [3, h, w]."""
    frame, scale, skin = leaf_window.frame, place.view.px_per_mm, scene.surface
    if not ranges.has("surface"):
        return surface.base_colours(skin)[0] * tf.ones_like(coverage)
    texture = None if textures is None else surface.photographed(textures, scene.key, frame)
    colour = surface.blade(skin, scene.key, frame, texture)
    if ranges.has("browned_margin"):
        colour = tf.cond(
            skin.margin_browned,
            lambda: surface.browned_margin(colour, skin, light.soften(coverage, frame, 3.0 * scale)),
            lambda: colour,
        )
    if ranges.has("spots"):
        colour = surface.spots(colour, skin, scene.key, frame)
    height = tf.zeros_like(coverage)
    if ranges.has("undulation"):
        height += surface.undulation(skin, scene.key, frame)
    if ranges.has("veins"):
        ridges = _veins(scene, place, leaf_window)
        colour = surface.vein_tint(colour, skin, ridges)
        height += 0.12 * ridges - 1.6 * skin.quilting * light.soften(ridges, frame, 1.2 * scale)
    if ranges.has("relief"):
        colour = light.relief(colour, surface.normals(height, scale), scene.light)
    return colour


def _veins(scene: Scene, place: Geometry, leaf_window: Window) -> tf.Tensor:
    """Height map H [h, w] of the veins in the leaf's window."""
    edges = veins.edges(scene.leaf, scene.key, scene.surface.vein_jitter, scene.surface.vein_width_mm)
    pixels = camera.project(place.view.to_px, place.pose.apply(edges)) - leaf_window.corner
    pieces = math.ceil(leaf_window.frame.longest / 28)
    return veins.height(raster.fill(raster.subdivide_edges(pixels, pieces), leaf_window.frame))


def _photograph(image: tf.Tensor, scene: Scene, place: Geometry, ranges: Ranges) -> tf.Tensor:
    """Light the scene [3, H, W] and take its photograph."""
    size = (image.shape[1], image.shape[2])
    if ranges.has("illumination"):
        image *= light.illumination(scene.light, scene.light_key, size)
    if ranges.has("glass"):
        image = light.glass(image, scene.light)
    if ranges.has("development"):
        image = camera.develop(image, scene.camera, paper.colour(scene.paper))
    if ranges.has("focus"):
        image = camera.focus(image, scene.camera, place.view.px_per_mm)
    if ranges.has("sensor_noise"):
        image = camera.sensor_noise(image, scene.camera, scene.light_key)
    if ranges.has("chroma_softness"):
        image = camera.chroma_softness(image, scene.camera)
    return image
