"""A picture is a pure function of a few dozen numbers: `sample` draws them, `render` turns them into a picture."""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import camera, desk, light, noise, paper, props, raster, surface, veins
from laesi_tf.synthesis import leaf as leaves
from laesi_tf.synthesis.camera import Camera, View
from laesi_tf.synthesis.desk import Desk
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.leaf import Leaf
from laesi_tf.synthesis.light import Light
from laesi_tf.synthesis.paper import Paper
from laesi_tf.synthesis.props import Props
from laesi_tf.synthesis.ranges import count, draw, draw_one_of
from laesi_tf.synthesis.surface import Surface

Size = tuple[int, int]

COMPONENTS = (
    "ruling",
    "paper_noise",
    "crease",
    "desk",
    *props.PROPS,
    "shadow",
    "surface",
    "spots",
    "veins",
    "relief",
    "illumination",
    "glass",
    "development",
    "focus",
    "sensor_noise",
    "chroma_softness",
)
"""What a picture is made of beside leaf and sheet, in the order it is laid on; each can be left out by name."""


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
        leaf=draw_one_of(kinds, _choose([weight for weight, _ in ranges.leaf.values()], which[0]), leaf_numbers),
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
        return tf.reshape(flat, points.shape)


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


def leaf_coverage(place: Geometry, size: Size) -> tf.Tensor:
    """Coverage [H, W] in [0, 1] of the leaf, holes open."""
    pieces = math.ceil(max(size) / 256)
    polygons = (place.outline, place.holes)
    edges = [
        tf.reshape(raster.segments(raster.subdivide(camera.project(place.view.to_px, points), pieces)), [-1, 2, 2])
        for points in polygons
    ]
    return tf.clip_by_value(tf.abs(raster.fill(tf.concat(edges, axis=0), size)), 0, 1)


def render(
    scene: Scene, size: Size, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> dict[str, tf.Tensor]:
    """Turn the numbers of a scene into a picture of `size` (height, width).

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's
    centroid) and `tilt_deg` float32 [], and `to_px` float32 [3, 3], sheet mm to pixels.
    """
    place = geometry(scene, size)
    coverage = leaf_coverage(place, size)
    image = _sheet(scene, place, size, ranges)
    if ranges.has("shadow"):
        image *= light.shadow(_pool(coverage), scene.light, size, place.view.px_per_mm)
    blade = _blade(scene, place, coverage, ranges, textures)
    image = _photograph(image + coverage * (blade - image), scene, place, ranges)
    # Transposing floats and then casting is three times faster than transposing bytes.
    pixels = tf.transpose(tf.clip_by_value(image * 255 + 0.5, 0, 255), [1, 2, 0])
    return {
        "image": tf.cast(pixels, tf.uint8),
        "mask": tf.cast(coverage >= 0.5, tf.uint8),
        "area_cm2": place.area_cm2,
        "px_per_mm": place.view.px_per_mm,
        "tilt_deg": scene.camera.tilt_deg * tf.cast(scene.camera.tilted, tf.float32),
        "to_px": place.view.to_px,
    }


def _sheet(scene: Scene, place: Geometry, size: Size, ranges: Ranges) -> tf.Tensor:
    """The sheet on its desk with everything that lies on it but the leaf: [3, H, W]."""
    x, y = camera.sheet_coordinates(place.view.to_px, size)
    view, sheet = place.view, scene.paper
    inks, shade = tf.ones([3, *size]), tf.ones(size)
    if ranges.has("ruling"):
        inks = paper.ruling(sheet, x, y, paper.samples_per_mm(size), 1 / view.px_per_mm)
    if ranges.has("paper_noise"):
        blend, strength = paper.wear(sheet, scene.key, size)
        inks, shade = 1 - (1 - inks) * strength, 1 + blend
    if ranges.has("crease"):
        shade += tf.cond(
            sheet.creased, lambda: paper.crease(sheet, x, y, view.fov_mm), lambda: tf.zeros_like(x)
        )
    image = paper.colour(sheet) * inks * shade
    if ranges.has("desk"):
        image = tf.cond(sheet.edged, lambda: _on_desk(image, inks, scene, place, (x, y)), lambda: image)
    stage = props.Stage(leaf=place.outline, view=view, size=size)
    return props.scatter(image, scene.props, stage, scene.key, [name for name in props.PROPS if ranges.has(name)])


def _on_desk(
    image: tf.Tensor, inks: tf.Tensor, scene: Scene, place: Geometry, position: tuple[tf.Tensor, tf.Tensor]
) -> tf.Tensor:
    """Cut the sheet's picture [3, H, W] to its rectangle, with an unprinted border, and lay it on the desk."""
    scale = place.view.px_per_mm
    box = tf.reduce_min(place.outline, axis=0), tf.reduce_max(place.outline, axis=0)
    printed, _ = paper.inside(*paper.extent(scene.paper, *box, inset_mm=scene.paper.border_mm), *position, scale)
    on_sheet, distance = paper.inside(*paper.extent(scene.paper, *box), *position, scale)
    image = image / tf.maximum(inks, 0.05) * (1 - printed) + image * printed
    table = desk.desk(scene.desk, scene.key, (image.shape[1], image.shape[2]))
    table *= desk.beside_sheet(scene.desk, distance)
    return table + on_sheet * (image - table)


def _blade(
    scene: Scene, place: Geometry, coverage: tf.Tensor, ranges: Ranges, textures: tf.Tensor | None
) -> tf.Tensor:
    """The lit leaf as if it filled the picture: [3, H, W]."""
    size, scale, skin = (coverage.shape[0], coverage.shape[1]), place.view.px_per_mm, scene.surface
    if not ranges.has("surface"):
        return surface.base_colours(skin)[0] * tf.ones([3, *size])
    texture = None if textures is None else surface.photographed(textures, scene.key, size)
    colour = surface.blade(skin, scene.key, size, texture)
    colour = surface.browned_margin(colour, skin, light.soften(_pool(coverage), size, 3.0 * scale))
    if ranges.has("spots"):
        colour = surface.spots(colour, skin, scene.key)
    height = surface.undulation(skin, scene.key, size)
    if ranges.has("veins"):
        ridges = _veins(scene, place, size)
        colour = surface.vein_tint(colour, skin, ridges)
        furrows = light.soften(_pool(ridges), size, 1.2 * scale)
        height += 0.12 * ridges - 1.6 * skin.quilting * furrows
    if ranges.has("relief"):
        colour = light.relief(colour, surface.normals(height, scale), scene.light)
    return colour


def _veins(scene: Scene, place: Geometry, size: Size) -> tf.Tensor:
    """Height map H [H, W] of the veins."""
    edges = veins.edges(scene.leaf, scene.key, scene.surface.vein_jitter, scene.surface.vein_width_mm)
    pixels = camera.project(place.view.to_px, place.pose.apply(edges))
    pieces = math.ceil(max(size) / 28)
    fraction = tf.linspace(0.0, 1.0, pieces + 1)[:, None]
    steps = pixels[:, :1] * (1 - fraction) + pixels[:, 1:] * fraction
    return veins.height(raster.fill(tf.reshape(tf.stack([steps[:, :-1], steps[:, 1:]], 2), [-1, 2, 2]), size))


def _photograph(image: tf.Tensor, scene: Scene, place: Geometry, ranges: Ranges) -> tf.Tensor:
    """Light the scene [3, H, W] and take its photograph."""
    size = (image.shape[1], image.shape[2])
    if ranges.has("illumination"):
        image *= light.illumination(scene.light, scene.light_key, size)
    if ranges.has("glass"):
        image = light.glass(image, scene.light)
    if ranges.has("development"):
        image = camera.develop(image, scene.camera)
    if ranges.has("focus"):
        image = camera.focus(image, scene.camera, place.view.px_per_mm)
    if ranges.has("sensor_noise"):
        image = camera.sensor_noise(image, scene.camera, scene.light_key)
    if ranges.has("chroma_softness"):
        image = camera.chroma_softness(image, scene.camera)
    return image


def _pool(coverage: tf.Tensor) -> tf.Tensor:
    """Mean of [H, W] over blocks of four pixels: enough for anything that is blurred next."""
    return tf.nn.avg_pool2d(coverage[None, ..., None], 4, 4, "SAME")[0, ..., 0]
