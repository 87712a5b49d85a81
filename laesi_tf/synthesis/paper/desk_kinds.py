"""Desks of wood, cloth, tiles and print, of which some repeat as a ruling does.

Patterns lie in the sheet's plane, in mm, so that they have one size whatever the view; each fades to its mean
where it is finer than the pixels.
"""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.noise import simple_noise
from laesi_tf.synthesis.paper.desk import DESK_NAMES, DeskParams
from laesi_tf.synthesis.ranges import Scalar


class DeskColours(NamedTuple):
    """The colours that desks of a kind have: ranges of hue, saturation and brightness (V of HSV)."""

    hue: tuple[float, float]
    saturation: tuple[float, float]
    brightness: tuple[float, float]


DESK_COLOURS = {
    "mottled": DeskColours((0.0, 1.0), (0.0, 0.25), (0.2, 0.95)),
    "wood": DeskColours((0.03, 0.11), (0.3, 0.75), (0.15, 0.85)),
    "woven": DeskColours((0.0, 1.0), (0.0, 0.55), (0.1, 0.95)),
    "checked": DeskColours((0.0, 1.0), (0.2, 0.9), (0.25, 0.9)),
    "tiles": DeskColours((0.02, 0.12), (0.0, 0.5), (0.2, 0.95)),
    "text": DeskColours((0.08, 0.16), (0.0, 0.12), (0.75, 1.0)),
    "dark": DeskColours((0.0, 1.0), (0.0, 0.5), (0.03, 0.3)),
    "green": DeskColours((0.28, 0.45), (0.3, 0.8), (0.12, 0.5)),
    "white": DeskColours((0.0, 1.0), (0.0, 0.06), (0.75, 1.0)),
}
"""By name, in the order of `DESK_NAMES`."""
_COLOURS = np.array([DESK_COLOURS[name] for name in DESK_NAMES], np.float32)


class DeskPlace(NamedTuple):
    """Where the desk's pixels lie: `along` and `across` [H, W] the desk's directions in mm, the scale
    `px_per_mm` [], and smooth noise `wander` [H, W], about [-1, 1]."""

    along: tf.Tensor
    across: tf.Tensor
    px_per_mm: tf.Tensor
    wander: tf.Tensor


def desk_colour(desk: DeskParams[Scalar]) -> tf.Tensor:
    """Return the base colour [3, 1, 1] of a desk of any kind."""
    limits = tf.gather(tf.constant(_COLOURS), tf.cast(desk.kind, tf.int32))
    shares = tf.stack([desk.hue_share, desk.saturation_share, desk.brightness_share])
    hue, saturation, brightness = tf.unstack(limits[:, 0] + shares * (limits[:, 1] - limits[:, 0]))
    return hsv_to_rgb(hue, saturation)[:, None, None] * brightness


def desk_pattern(
    desk: DeskParams[Scalar],
    grid: tf.Tensor,
    x_mm: tf.Tensor,
    y_mm: tf.Tensor,
    px_per_mm: tf.Tensor,
    size: ImageSize,
) -> tf.Tensor:
    """Return the brightness [H, W] of a desk of any kind, relative to its base colour.

    `grid` [n, n] are uniform numbers of its noise; `x_mm` and `y_mm` [H, W] are positions on the sheet.
    """
    cosine, sine = tf.cos(desk.angle), tf.sin(desk.angle)
    wander = simple_noise(grid, size, cells=desk.grain_cells * 0.25).values
    place = DeskPlace(x_mm * cosine + y_mm * sine, y_mm * cosine - x_mm * sine, px_per_mm, wander)

    def mottled() -> tf.Tensor:
        return 1 + desk.grain * simple_noise(grid, size, cells=desk.grain_cells).values

    def plain() -> tf.Tensor:
        return 1 + 0.1 * desk.grain * wander

    patterns = {
        "mottled": mottled,
        "wood": lambda: wood_pattern(desk, place),
        "woven": lambda: woven_pattern(desk, place),
        "checked": lambda: checked_pattern(desk, place),
        "tiles": lambda: tile_pattern(desk, place),
        "text": lambda: text_pattern(desk, place),
        "dark": plain,
        "green": plain,
        "white": plain,
    }
    return tf.switch_case(tf.cast(desk.kind, tf.int32), [patterns[name] for name in DESK_NAMES])


def wood_pattern(desk: DeskParams[Scalar], place: DeskPlace) -> tf.Tensor:
    """Return the brightness of boards: wandering rings and fibres along them, and joints between them."""
    board = tf.floor(place.across / desk.board_mm)
    rings = place.across + 14 * place.wander + 40 * _hash(board, 0.3)
    grain = 0.0
    for period_mm, share in ((desk.pitch_mm, 0.5), (desk.pitch_mm * 0.37, 0.3), (desk.pitch_mm * 0.12, 0.2)):
        turns = (rings + 0.02 * place.along) / period_mm
        grain += share * _fade(place.px_per_mm, period_mm) * tf.sin(2 * math.pi * turns)
    joint = _line(place.across, desk.board_mm, desk.joint_mm, place.px_per_mm)
    return (1 + desk.grain * grain) * (0.9 + 0.2 * _hash(board, 0.7)) * (1 - 0.5 * joint)


def woven_pattern(desk: DeskParams[Scalar], place: DeskPlace) -> tf.Tensor:
    """Return the brightness of a plain weave: threads of two directions, over and under by turns."""
    along, across = (
        (line + 0.3 * desk.thread_mm * place.wander) * (math.pi / desk.thread_mm)
        for line in (place.along, place.across)
    )
    thread = 0.3 * (tf.cos(2 * along) + tf.cos(2 * across)) + 0.6 * tf.sin(along) * tf.sin(across)
    return 1 + desk.grain * (1.5 * _fade(place.px_per_mm, desk.thread_mm) * thread + 0.15 * place.wander)


def checked_pattern(desk: DeskParams[Scalar], place: DeskPlace) -> tf.Tensor:
    """Return the brightness of checked cloth: stripes of two directions."""
    stripes = [
        _line(line + 0.5 * place.wander, desk.pitch_mm, 0.5 * desk.pitch_mm, place.px_per_mm)
        for line in (place.along, place.across)
    ]
    return 1 - desk.contrast * 0.5 * (stripes[0] + stripes[1])


def tile_pattern(desk: DeskParams[Scalar], place: DeskPlace) -> tf.Tensor:
    """Return the brightness of tiles or bricks, each of its own tone, and of the joints between them."""
    length_mm = desk.board_mm * desk.tile_aspect
    row = tf.floor(place.across / desk.board_mm)
    along = place.along + tf.where(desk.bonded, 0.5 * length_mm, 0.0) * (row - 2 * tf.floor(row / 2))
    tone = 0.85 + 0.3 * _hash(row, tf.floor(along / length_mm)) + desk.grain * 0.3 * place.wander
    joint = tf.maximum(
        _line(place.across, desk.board_mm, desk.joint_mm, place.px_per_mm),
        _line(along, length_mm, desk.joint_mm, place.px_per_mm),
    )
    grout = 1 + (desk.hue_share - 0.6) * desk.contrast
    return tone + joint * (grout - tone)


def text_pattern(desk: DeskParams[Scalar], place: DeskPlace) -> tf.Tensor:
    """Return the brightness of print: rows of words of letters, each of a few strokes."""
    row_mm = 1.8 + 0.25 * desk.pitch_mm
    letter_mm = 0.35 * row_mm
    row = tf.floor(place.across / row_mm)
    height = place.across / row_mm - row
    is_line = tf.cast((height > 0.25) & (height < 0.75), tf.float32)
    is_letter = tf.cast(_hash(tf.floor(place.along / letter_mm), row) > 0.18, tf.float32)
    cell = tf.floor(place.along * (4 / letter_mm)), tf.floor(height * 12) + 13 * row
    stroke = tf.cast(_hash(*cell) > 0.5, tf.float32)
    # Strokes, then rows, fade to their mean where pixels are wider than they are.
    strokes_seen = tf.clip_by_value(letter_mm / 4 * place.px_per_mm - 0.2, 0, 1)
    rows_seen = tf.clip_by_value(0.5 * row_mm * place.px_per_mm - 0.3, 0, 1)
    ink = is_line * is_letter * (0.5 + strokes_seen * (stroke - 0.5))
    return 1 - desk.contrast * (0.2 + rows_seen * (ink - 0.2))


def _line(
    position_mm: tf.Tensor, period_mm: tf.Tensor, width_mm: tf.Tensor, px_per_mm: tf.Tensor
) -> tf.Tensor:
    """Return the coverage of pixels by lines of `width_mm` at multiples of `period_mm`; mean where finer."""
    turns = position_mm / period_mm
    distance_mm = tf.abs(turns - tf.round(turns)) * period_mm
    sharp = tf.clip_by_value((width_mm / 2 - distance_mm) * px_per_mm + 0.5, 0, 1)
    share = width_mm / period_mm
    return share + tf.clip_by_value(period_mm * px_per_mm - 1.5, 0, 1) * (sharp - share)


def _fade(px_per_mm: tf.Tensor, period_mm: tf.Tensor) -> tf.Tensor:
    """Return what pixels leave of a wave: nothing below two pixels a period."""
    return tf.clip_by_value(period_mm * px_per_mm / 2 - 1, 0, 1)


def _hash(one: tf.Tensor | float, other: tf.Tensor | float) -> tf.Tensor:
    """Return numbers in [0, 1) that look random, of whole numbers `one` and `other`."""
    mixed = tf.sin(one * 12.9898 + other * 78.233) * 437.5853
    return mixed - tf.floor(mixed)
