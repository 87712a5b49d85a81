"""A sticky note, a sticker with a barcode, and a long stroke of a pen."""

import math
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import stroke_outlines
from laesi_tf.synthesis.props.handwriting import InkParams, handwriting_stroke, ink_colour
from laesi_tf.synthesis.props.placement import UNIT_SQUARE, PropContext, PropParams, PropShape, place_parts
from laesi_tf.synthesis.props.ruler import join_bars
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability

_BARS = 32
_BAR_WIDTHS = 0.2 + 0.6 * np.random.default_rng(5).integers(0, 3, _BARS) / 2
"""Widths of bars over the distance of their middles."""


@dataclass(frozen=True)
class NoteParams(InkParams[Value]):
    """A sticky note."""

    note: Value = probability(0.0)
    note_mm: Value = interval(20, 76)
    """Side."""
    note_aspect: Value = interval(0.35, 1.0)
    note_saturation: Value = interval(0.15, 0.65)


def make_note(
    note: NoteParams[Scalar], largest: NoteParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a coloured note with a word, and its shadow."""
    size = note.note_mm * tf.stack([1.0, note.note_aspect])
    word = handwriting_stroke(numbers[:32], 0.6 * size[0], 0.16 * size[1], note)
    card, writing = place_parts([UNIT_SQUARE * size / 2, word], context, note, turn=note.turn)
    paint = hsv_to_rgb(note.hue, note.note_saturation)[:, None, None] * (0.8 + 0.2 * numbers[40])
    paper = PropShape(card, paint, 4.2 * largest.note_mm)
    return [paper.shadow(0.4), paper, PropShape(writing, ink_colour(note), 5 * largest.note_mm, opacity=0.9)]


@dataclass(frozen=True)
class BarcodeParams(PropParams[Value]):
    """A sticker with a barcode."""

    barcode: Value = probability(0.0)
    barcode_mm: Value = interval(20, 60)
    barcode_aspect: Value = interval(0.25, 0.5)


def make_barcode(
    barcode: BarcodeParams[Scalar], largest: BarcodeParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a white sticker and its bars."""
    size = barcode.barcode_mm * tf.stack([1.0, barcode.barcode_aspect])
    places = (np.arange(_BARS) + 0.5) / _BARS
    bars = (join_bars(places, np.ones(_BARS), _BAR_WIDTHS / _BARS) - 0.5) * size * [0.85, 0.6]
    card, code = place_parts([UNIT_SQUARE * size / 2, bars], context, barcode, turn=barcode.turn)
    paper = PropShape(card, tf.fill([3, 1, 1], 0.88 + 0.1 * numbers[0]), 3.1 * largest.barcode_mm)
    perimeter_mm = 2.2 * largest.barcode_mm * (1 + 0.6 * _BARS * largest.barcode_aspect)
    return [paper.shadow(0.3), paper, PropShape(code, tf.fill([3, 1, 1], 0.08), perimeter_mm)]


@dataclass(frozen=True)
class ScribbleParams(InkParams[Value]):
    """A stroke of a pen."""

    scribble: Value = probability(0.0)
    scribble_mm: Value = interval(15, 120)
    """Length of the stroke."""
    scribble_turns: Value = interval(-1.2, 1.2)
    """Turns from one end to the other."""


def make_scribble(
    scribble: ScribbleParams[Scalar], largest: ScribbleParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a long curved stroke on the sheet itself: a line, an arc or a ring."""
    t = tf.constant(np.linspace(0, 1, 49), tf.float32)
    heading = 2 * math.pi * scribble.scribble_turns * t + 0.5 * tf.sin(9 * t + 6 * numbers[0])
    steps = scribble.scribble_mm / 48 * tf.stack([tf.cos(heading), tf.sin(heading)], axis=-1)
    path = tf.cumsum(steps, axis=0)
    stroke = stroke_outlines(path - tf.reduce_mean(path, axis=0), tf.fill([49], scribble.stroke_mm))
    (points,) = place_parts([stroke], context, scribble, turn=scribble.turn)
    return [PropShape(points, ink_colour(scribble), 2.4 * largest.scribble_mm, opacity=0.85)]
