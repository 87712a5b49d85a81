"""Things beside the leaf: paper scraps, label cards, pens, coins, handwriting (paper, "Scene Composition").

And the red squares that rule-based methods take the scale from, where ranges ask for them.

Each is a unit shape moved by T_xy R_theta S_xy, in sheet millimetres. A prop's place is found along a
direction from the leaf: the leaf's support in that direction plus the prop's own, plus a gap, so the straight
line between them proves that it never covers the leaf. A prop that a scene lacks costs nothing.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import camera, curves, paper, raster, veins
from laesi_tf.synthesis.frame import Size, Window, window
from laesi_tf.synthesis.fusing import fused
from laesi_tf.synthesis.keys import Key, Purpose
from laesi_tf.synthesis.ranges import Chance, Number, late

WRITING_POINTS = 48
_DIRECTIONS = 16
"""In which a place for the calibration square is looked for."""


@dataclass(frozen=True)
class Props:
    """What lies in a scene; sizes in mm, directions and turns in radians, colours in HSV."""

    fragment: Number = Chance(0.16)
    fragment_mm: Number = (8, 40)
    fragment_aspect: Number = (0.4, 1.0)
    label: Number = Chance(0.2)
    label_mm: Number = (14, 45)
    label_aspect: Number = (0.3, 0.7)
    pen: Number = Chance(0.1)
    pen_mm: Number = (70, 150)
    pen_thickness_mm: Number = (6, 12)
    coin: Number = Chance(0.1)
    coin_mm: Number = (16, 26)
    handwriting: Number = Chance(0.25)
    handwriting_mm: Number = (8, 34)
    handwriting_height: Number = (0.12, 0.4)
    direction: Number = (-math.pi, math.pi)
    gap_mm: Number = (2, 30)
    turn: Number = (-math.pi, math.pi)
    hue: Number = (0.0, 1.0)
    saturation: Number = (0.0, 0.9)
    ink_value: Number = (0.05, 0.4)
    stroke_mm: Number = (0.3, 0.9)
    calibration: Number = late(Chance(0.0))
    calibration_mm: Number = late(20.0)
    """Side of the red square. Of 4 cm2, as Easy Leaf Area takes it to be, and the same in all pictures."""
    calibration_hue: Number = late((-0.02, 0.02))
    calibration_saturation: Number = late((0.75, 0.95))
    calibration_value: Number = late((0.65, 0.9))


class Stage(NamedTuple):
    """Where props are placed: the leaf's outline [n, 2] (sheet mm), the view and the picture's size.

    Where a stage is compiled for, `size` bounds the picture's and `frame` [2] is its width and height.
    """

    leaf: tf.Tensor
    view: camera.View
    size: Size
    frame: tf.Tensor | None = None


def place(
    shape: tf.Tensor, stage: Stage, direction: tf.Tensor, turn: tf.Tensor, gap_mm: tf.Tensor
) -> tf.Tensor:
    """Turn `shape` [n, 2] (mm, centred) and push it off the leaf along `direction`: sheet mm [n, 2]."""
    cosine, sine = tf.cos(turn), tf.sin(turn)
    turned = shape @ tf.stack([tf.stack([cosine, sine]), tf.stack([-sine, cosine])])
    away = tf.stack([tf.cos(direction), tf.sin(direction)])
    support = tf.reduce_max(tf.linalg.matvec(stage.leaf, away))
    own = -tf.reduce_min(tf.linalg.matvec(turned, away))
    return turned + away * (support + own + gap_mm)


class Item(NamedTuple):
    """One flat shape of a prop: its polygon [n, 2] in sheet mm, colour [3, 1, 1] and opacity.

    `perimeter_mm` bounds its length around: the number of points it is filled with.
    """

    points: tf.Tensor
    colour: tf.Tensor
    perimeter_mm: float
    opacity: float = 1.0

    def shadow(self, thickness_mm: float) -> "Item":
        """The narrow shadow that it throws on the sheet when it is `thickness_mm` thick."""
        return Item(self.points + thickness_mm, tf.zeros([3, 1, 1]), self.perimeter_mm, 0.25)


class Drawn(NamedTuple):
    """The k items of a prop in the picture, the lowest first: the window around them, what their edges leave
    in it, each item in its own layer, and their colours [k, 3, 1, 1] and opacities [k]."""

    around: Window
    left: raster.Deposits
    colours: tf.Tensor
    opacities: tf.Tensor


def _drawn(name: str, props: Props, stage: Stage, random: tf.Tensor) -> Drawn:
    """Prop `name` in a picture of the stage's size."""
    # Compiling takes half a second a prop: sizes that share a power of two share what is compiled.
    side = max(256, 2 ** math.ceil(math.log2(max(stage.size))))
    frame = tf.constant(stage.size[::-1], tf.float32)
    return _drawn_within(name, props, stage._replace(size=(side, side), frame=frame), random)


@fused
def _drawn_within(name: str, props: Props, stage: Stage, random: tf.Tensor) -> Drawn:
    """`_drawn`, compiled for the stage's size."""
    items = PROPS[name](props, stage, random)
    edges = [_edges(item, stage) for item in items]
    layers = np.repeat(np.arange(len(items), dtype=np.int32), [polygon.shape[0] for polygon in edges])
    together = tf.concat(edges, axis=0)
    corners = together[:, 0]
    around = window(tf.reduce_min(corners, axis=0), tf.reduce_max(corners, axis=0) + 1, stage.frame)
    return Drawn(
        around=around,
        left=raster.deposits(together - around.corner, around.size, layers=tf.constant(layers)),
        colours=tf.stack([item.colour for item in items]),
        opacities=tf.stack([item.opacity for item in items]),
    )


def _edges(item: Item, stage: Stage) -> tf.Tensor:
    """Edges of `item` in pixels, short enough to be filled in a picture of the stage's size."""
    count = math.ceil(item.perimeter_mm * max(stage.size) / 70)
    return raster.segments(raster.resample(camera.project(stage.view.to_px, item.points), count))


def _lay(image: tf.Tensor, drawn: Drawn, size: Size) -> tf.Tensor:
    """Lay a prop over [3, H, W], within the window that it covers."""
    around, count = drawn.around, drawn.colours.shape[0]
    heights = raster.summed(drawn.left, around.size, layers=count)
    covers = raster.union(raster.accumulated(heights, around.size, layers=count))
    before = part = around.cut(image)
    for layer in range(count):
        part += drawn.opacities[layer] * covers[layer] * (drawn.colours[layer] - part)
    return image + around.paste(part - before, size)


def fragment(props: Props, stage: Stage, random: tf.Tensor) -> list[Item]:
    """A torn scrap of paper."""
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    reach = 1 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    square = tf.constant(np.stack([np.cos(angle), np.sin(angle)], -1) * reach[:, None], tf.float32)
    ragged = square * (0.85 + 0.15 * random[:16, None])
    scale = props.fragment_mm / 2 * tf.stack([1.0, props.fragment_aspect])
    points = place(ragged * scale, stage, props.direction, props.turn, props.gap_mm)
    colour = paper.tint(props.hue, props.saturation * 0.15)[:, None, None] * (0.8 + 0.18 * random[20])
    scrap = Item(points, colour, 180)
    return [scrap.shadow(0.5), scrap]


def label(props: Props, stage: Stage, random: tf.Tensor) -> list[Item]:
    """A label card with two lines of writing."""
    half = props.label_mm / 2 * tf.stack([1.0, props.label_aspect])
    lines = [
        scribble(
            random[32 * i : 32 * i + 32],
            props.label_mm * 0.7,
            props.label_mm * props.label_aspect * 0.14,
            props,
        )
        + tf.stack([0.0, (0.4 * i - 0.2) * props.label_mm * props.label_aspect])
        for i in range(2)
    ]
    shapes = tf.concat([_box() * half, *lines], axis=0)
    direction = props.direction + 2.0
    points = place(
        shapes,
        stage,
        direction,
        tf.round(props.turn * 2 / math.pi) * (math.pi / 2) + 0.1 * random[70],
        props.gap_mm,
    )
    colour = paper.tint(props.hue, props.saturation * 0.1)[:, None, None] * 0.95
    words = [Item(word, _ink(props), 260) for word in tf.split(points[4:], 2)]
    card = Item(points[:4], colour, 170)
    return [card.shadow(0.5), card, *words]


def handwriting(props: Props, stage: Stage, random: tf.Tensor) -> list[Item]:
    """A word written on the sheet itself."""
    word = scribble(
        random[:32], props.handwriting_mm, props.handwriting_mm * props.handwriting_height / 2, props
    )
    points = place(word, stage, props.direction + 4.0, props.turn * 0.15, props.gap_mm)
    return [Item(points, _ink(props), 320, opacity=0.85)]


def pen(props: Props, stage: Stage, random: tf.Tensor) -> list[Item]:
    """A pen: a tapered rod, bright along its back."""
    profile = tf.constant(
        [[-1, -1], [0.75, -1], [0.97, -0.25], [1, 0], [0.97, 0.25], [0.75, 1], [-1, 1]], tf.float32
    )
    scale = tf.stack([props.pen_mm, props.pen_thickness_mm]) / 2
    points = place(profile * scale, stage, props.direction + 1.0, props.turn, props.gap_mm)
    back = place(profile * scale * [0.94, 0.22], stage, props.direction + 1.0, props.turn, props.gap_mm)
    back += (points[0] + points[6]) / 2 - (back[0] + back[6]) / 2
    colour = paper.tint(props.hue, props.saturation)[:, None, None] * (0.1 + 0.7 * random[0])
    shine = Item(back, tf.ones([3, 1, 1]), 340, opacity=0.35)
    rod = Item(points, colour, 340)
    return [rod.shadow(1.0), rod, shine]


def coin(props: Props, stage: Stage, random: tf.Tensor) -> list[Item]:
    """A coin-like disk, with a raised rim."""
    angle = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    circle = tf.constant(np.stack([np.cos(angle), np.sin(angle)], -1), tf.float32) * (props.coin_mm / 2)
    points = place(circle, stage, props.direction + 3.0, props.turn, props.gap_mm)
    centre = tf.reduce_mean(points, axis=0)
    metal = tf.stack([0.62 + 0.2 * random[0], 0.6 + 0.15 * random[0], 0.55 - 0.15 * random[1]])[:, None, None]
    face = Item(centre + (points - centre) * 0.85, metal * 0.6, 90, opacity=0.3)
    disk = Item(points, metal, 90)
    return [disk.shadow(0.7), disk, face]


def calibration(props: Props, stage: Stage, random: tf.Tensor) -> list[Item]:
    """A flat red square beside the leaf, in the direction in which most of it is seen."""
    square = _box() * props.calibration_mm / 2
    turns = random[0] * 2 * math.pi + np.arange(_DIRECTIONS, dtype=np.float32) * (2 * math.pi / _DIRECTIONS)
    gap_mm = props.gap_mm / 4
    places = tf.stack(
        [place(square, stage, direction, props.turn, gap_mm) for direction in tf.unstack(turns)]
    )
    corners = camera.project(stage.view.to_px, places)
    inside = tf.reduce_min(tf.minimum(corners, stage.frame - corners), axis=[1, 2])
    points = tf.gather(places, tf.argmax(inside))
    red = paper.tint(props.calibration_hue, props.calibration_saturation) * props.calibration_value
    return [Item(points, red[:, None, None], 160)]


def scribble(random: tf.Tensor, length_mm: tf.Tensor, height_mm: tf.Tensor, props: Props) -> tf.Tensor:
    """A handwritten word as one ribbon [2 * WRITING_POINTS, 2] mm, centred: loops of random height."""
    t = tf.constant(np.linspace(0, 1, WRITING_POINTS), tf.float32)
    letters = 8
    knots = tf.constant(curves.linear(letters + 1, WRITING_POINTS))
    loops = 2 * math.pi * letters * t
    tall = tf.linalg.matvec(knots, random[: letters + 1])
    lean = tf.linalg.matvec(knots, random[letters + 1 : 2 * letters + 2])
    x = (t - 0.5) * length_mm + height_mm * 0.7 * lean * tf.cos(loops)
    y = height_mm * (0.35 + tall) * tf.sin(loops)
    return veins.ribbons(tf.stack([x, y], -1), tf.fill([WRITING_POINTS], props.stroke_mm))


def _ink(props: Props) -> tf.Tensor:
    return paper.tint(props.hue * 0.3 + 0.5, props.saturation)[:, None, None] * props.ink_value


def _box() -> tf.Tensor:
    return tf.constant([[-1, -1], [1, -1], [1, 1], [-1, 1]], tf.float32)


PROPS: dict[str, Callable[[Props, Stage, tf.Tensor], list[Item]]] = {
    "handwriting": handwriting,
    "fragment": fragment,
    "label": label,
    "coin": coin,
    "pen": pen,
    "calibration": calibration,
}
"""From flat to high, the order in which they are laid down, but for the square, which nothing may hide; each
is present by the number of its name and returns its items, the lowest first. New ones go to the end: the
random numbers of those before them then stay what they were."""


def scatter(image: tf.Tensor, props: Props, stage: Stage, key: Key, names: list[str]) -> tf.Tensor:
    """Lay the props in `names` that the scene has onto [3, H, W]."""
    random = key.uniform([len(PROPS), 80], Purpose.PROPS)
    for row, name in enumerate(PROPS):
        if name in names:
            image = tf.cond(
                getattr(props, name),
                lambda image=image, name=name, row=row: _lay(
                    image, _drawn(name, props, stage, random[row]), stage.size
                ),
                lambda image=image: image,
            )
    return image
