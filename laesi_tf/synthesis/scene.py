"""A picture is a pure function of a few dozen numbers: `sample` draws them, `render` makes the picture."""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import camera, desk, light, noise, paper, pixels, props, raster, surface, veins
from laesi_tf.synthesis import leaf as leaves
from laesi_tf.synthesis.camera import Camera, View
from laesi_tf.synthesis.desk import Desk
from laesi_tf.synthesis.frame import Frame, Size, Window, window
from laesi_tf.synthesis.fusing import fused
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
    key, light_key = Key(seed, index // ranges.lighting_passes), Key(seed, index)
    rooms = {name: getattr(ranges, name) for name in ("paper", "surface", "props", "camera", "desk")}
    kinds = [kind for _, kind in ranges.leaf.values()]
    sizes = [1, count(kinds[0]), *(count(room) for room in rooms.values())]
    which, leaf_numbers, *others = tf.split(key.uniform([sum(sizes)], Purpose.SCENE), sizes)
    drawn = {name: draw(room, part) for (name, room), part in zip(rooms.items(), others, strict=True)}
    kind = _choose([weight for weight, _ in ranges.leaf.values()], which[0])
    return Scene(
        kind=kind,
        leaf=draw_one_of(kinds, kind, leaf_numbers),
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
    outline, holes = leaves.outline(scene.leaf, scene.key), leaves.holes(scene.leaf, scene.key)
    # The size as a tensor: one compilation serves all sizes, and the label is the same at each.
    return _laid(scene.leaf, scene.camera, outline, holes, tf.constant(size, tf.float32))


@fused
def _laid(leaf: Leaf, held: Camera, outline: tf.Tensor, holes: tf.Tensor, size: tf.Tensor) -> Geometry:
    """`geometry` of an outline [n, 2] and holes [k, m, 2] in leaf coordinates, mm."""
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


@fused
def _leaf_deposits(
    edges: tf.Tensor, size: Size
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor, tf.Tensor, raster.Deposits]:
    """The window around the leaf's `edges` (top, left, height, width) and their deposits in it."""
    corners = tf.reshape(edges, [-1, 2])
    around = window(tf.reduce_min(corners, axis=0), tf.reduce_max(corners, axis=0), size)
    frame = around.frame
    deposits = raster.deposits(edges - around.corner, frame)
    return around.top, around.left, frame.height, frame.width, deposits


def render(
    scene: Scene, size: Size, ranges: Ranges, *, textures: tf.Tensor | None = None
) -> dict[str, tf.Tensor]:
    """Turn the numbers of a scene into a picture of `size` (height, width).

    Returns `image` uint8 [H, W, 3], `mask` uint8 [H, W] 0/1, `area_cm2`, `px_per_mm` (at the leaf's
    centroid) and `tilt_deg` float32 [], `to_px` float32 [3, 3], sheet mm to pixels, and `kind` int32 [],
    which of the ranges' kinds of leaves it is.
    """
    place = geometry(scene, size)
    top, left, height, width, deposits = _leaf_deposits(leaf_edges(place, size), size)
    leaf_window = Window(top, left, Frame(height, width, max(size)))
    filled = raster.filled(deposits, leaf_window.frame)
    # The outline runs clockwise, which fills with -1. Where a margin crosses itself it turns the other way:
    # that is leaf neither for the mask nor for the label.
    inner_coverage = tf.clip_by_value(-filled, 0, 1)
    coverage = leaf_window.paste(inner_coverage, size)
    image = _exposed(scene, place, (inner_coverage, leaf_window), size, ranges, textures)
    return {
        "image": _developed(image, scene, place, ranges),
        "mask": tf.cast(coverage + 0.5, tf.uint8),
        "area_cm2": place.area_cm2,
        "px_per_mm": place.view.px_per_mm,
        "tilt_deg": scene.camera.tilt_deg * tf.cast(scene.camera.tilted, tf.float32),
        "to_px": place.view.to_px,
        "kind": scene.kind,
    }


def _sheet(scene: Scene, place: Geometry, size: Size, ranges: Ranges) -> tf.Tensor:
    """The sheet on its desk with everything that lies on it but the leaf: [3, H, W]."""
    view, sheet = place.view, scene.paper
    shade, strength, lines = tf.ones(size), None, None
    if ranges.has("paper_noise"):
        blend, strength = paper.wear(sheet, scene.key, size)
        shade += blend
    if ranges.has("crease"):
        shade = tf.cond(
            sheet.creased, lambda: pixels.creased(sheet, shade, view.to_px, view.fov_mm), lambda: shade
        )
    if ranges.has("ruling"):
        passing = paper.transmission(sheet, paper.samples_per_mm(size), 1 / view.px_per_mm)
        lines = pixels.ruled(sheet, passing, view.to_px, size)
    made = pixels.Print(shade, strength, lines)

    def on_desk() -> tf.Tensor:
        grain = desk.grain(scene.desk, scene.key, size)
        extent = tf.stack([tf.reduce_min(place.outline, axis=0), tf.reduce_max(place.outline, axis=0)])
        distance = pixels.margin(sheet, extent, view.to_px, size)
        return pixels.on_desk(sheet, made, scene.desk, grain, distance, view.px_per_mm)

    def filling() -> tf.Tensor:
        return pixels.filling(sheet, made)

    image = tf.cond(sheet.edged, on_desk, filling) if ranges.has("desk") else filling()
    stage = props.Stage(leaf=place.outline, view=view, size=size)
    return props.scatter(
        image, scene.props, stage, scene.key, [name for name in props.PROPS if ranges.has(name)]
    )


def _exposed(
    scene: Scene,
    place: Geometry,
    leaf: tuple[tf.Tensor, Window],
    size: Size,
    ranges: Ranges,
    textures: tf.Tensor | None,
) -> tf.Tensor:
    """The whole scene, lit and developed, before lens and sensor: [3, H, W]."""
    coverage, leaf_window = leaf
    fields = _blade(scene, place, coverage, leaf_window, ranges, textures)
    blade = pixels.Blade(*(field if field is None else leaf_window.paste(field, size) for field in fields))
    if blade.facing is not None:
        blade = blade._replace(facing=pixels.facing(blade.facing, scene.light, place.view.px_per_mm))
    shadow, illumination, reflected = None, None, None
    if ranges.has("shadow"):
        shadow = light.shadow(blade.coverage, scene.light, size, place.view.px_per_mm)
    if ranges.has("illumination"):
        illumination = light.illumination(scene.light, scene.light_key, size)
    if ranges.has("glass"):
        reflected = light.glass(scene.light, size)
    sheet = _sheet(scene, place, size, ranges)
    image = pixels.with_leaf(sheet, blade, shadow, scene.surface, scene.light)
    held = scene.camera if ranges.has("development") else None
    return pixels.exposed(image, illumination, reflected, held, scene.paper)


def _blade(
    scene: Scene,
    place: Geometry,
    coverage: tf.Tensor,
    leaf_window: Window,
    ranges: Ranges,
    textures: tf.Tensor | None,
) -> pixels.Blade:
    """Fields [h, w] of the leaf in the window that it lies in."""
    frame, scale, skin = leaf_window.frame, place.view.px_per_mm, scene.surface
    if not ranges.has("surface"):
        return pixels.Blade(coverage)
    inwardness, ridges = None, None
    if ranges.has("browned_margin"):
        inwardness = tf.cond(
            skin.margin_browned,
            lambda: light.soften(coverage, frame, 3.0 * scale).field,
            lambda: tf.ones_like(coverage),
        )
    if ranges.has("veins"):
        ridges = _veins(scene, place, leaf_window)
    return pixels.Blade(
        coverage=coverage,
        blend=surface.blend(skin, scene.key, frame),
        mottle=surface.mottle(skin, scene.key, frame),
        texture=None if textures is None else surface.photographed(textures, scene.key, frame),
        inwardness=inwardness,
        spots=surface.spots(skin, scene.key, frame) if ranges.has("spots") else None,
        ridges=ridges,
        facing=_height(scene, place, ridges, frame, ranges) if ranges.has("relief") else None,
    )


def _height(
    scene: Scene, place: Geometry, ridges: tf.Tensor | None, frame: Frame, ranges: Ranges
) -> tf.Tensor:
    """Height map [h, w] of the leaf's surface in mm."""
    skin, height = scene.surface, noise.Factors(tf.zeros([frame.height, 1]), tf.zeros([frame.width, 1]))
    if ranges.has("undulation"):
        height += surface.undulation(skin, scene.key, frame)
    if ridges is None:
        return height.field
    bulge = light.soften(ridges, frame, 1.2 * place.view.px_per_mm) * (-1.6 * skin.quilting)
    return (height + bulge).field + 0.12 * ridges


def _veins(scene: Scene, place: Geometry, leaf_window: Window) -> tf.Tensor:
    """Height map H [h, w] of the veins in the leaf's window."""
    edges = veins.edges(scene.leaf, scene.key, scene.surface.vein_jitter, scene.surface.vein_width_mm)
    deposits = _vein_deposits(edges, place.pose, place.view.to_px, leaf_window)
    return veins.height(raster.filled(deposits, leaf_window.frame))


@fused
def _vein_deposits(edges: tf.Tensor, pose: Pose, to_px: tf.Tensor, leaf_window: Window) -> raster.Deposits:
    """Deposits in the leaf's window of veins' `edges` [n, 2 ends, 2] in leaf coordinates, mm."""
    in_window = camera.project(to_px, pose.apply(edges)) - leaf_window.corner
    pieces = math.ceil(leaf_window.frame.longest / 28)
    return raster.deposits(raster.subdivide_edges(in_window, pieces), leaf_window.frame)


def _developed(image: tf.Tensor, scene: Scene, place: Geometry, ranges: Ranges) -> tf.Tensor:
    """What lens, sensor and file make of the exposed image [3, H, W]: bytes [H, W, 3]."""
    size, grain = (image.shape[1], image.shape[2]), None
    if ranges.has("focus"):
        image = camera.focus(image, scene.camera, place.view.px_per_mm)
    if ranges.has("sensor_noise"):
        grain = noise.grain(scene.light_key.uniform([2], Purpose.SENSOR), size)

    def crisp() -> tf.Tensor:
        return pixels.quantised(image, scene.camera, grain)

    def soft() -> tf.Tensor:
        grained = image if grain is None else pixels.noisy(image, scene.camera, grain)
        return pixels.quantised(camera.chroma_softness(grained), scene.camera, None)

    return tf.cond(scene.camera.compressed, soft, crisp) if ranges.has("chroma_softness") else crisp()
