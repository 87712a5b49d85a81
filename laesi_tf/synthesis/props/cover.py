"""Clear things that lie over the leaf: a strip of tape, a pane of glass. The leaf is seen through them."""

from dataclasses import dataclass

import tensorflow as tf

from laesi_tf.synthesis.geometry import stroke_outlines
from laesi_tf.synthesis.props.placement import UNIT_SQUARE, PropContext, PropParams, PropShape, turn_points
from laesi_tf.synthesis.ranges import Scalar, Value, interval, probability


@dataclass(frozen=True)
class TapeParams(PropParams[Value]):
    """A strip of tape over the leaf's edge or petiole."""

    tape: Value = probability(0.0)
    tape_mm: Value = interval(20, 80)
    tape_width_mm: Value = interval(10, 25)
    tape_opacity: Value = interval(0.08, 0.3)


def make_tape(
    tape: TapeParams[Scalar], largest: TapeParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a clear strip across a point of the leaf's outline."""
    count = context.outline.shape[0]
    middle = tf.gather(context.outline, tf.cast(numbers[0] * count, tf.int32))
    points = turn_points(UNIT_SQUARE * tf.stack([tape.tape_mm, tape.tape_width_mm]) / 2, tape.turn) + middle
    colour = tf.stack([0.95, 0.93, 0.8 + 0.15 * numbers[1]])[:, None, None]
    return [
        PropShape(points, colour, 2.1 * (largest.tape_mm + largest.tape_width_mm), opacity=tape.tape_opacity)
    ]


@dataclass(frozen=True)
class PaneParams(PropParams[Value]):
    """A pane of glass that presses the leaf flat."""

    pane: Value = probability(0.0)
    pane_margin_mm: Value = interval(4, 40)
    """From the leaf's bounding circle to the pane's sides."""
    pane_opacity: Value = interval(0.03, 0.16)


_LARGEST_LEAF_MM = 260


def make_pane(
    pane: PaneParams[Scalar], largest: PaneParams[float], context: PropContext, numbers: tf.Tensor
) -> list[PropShape]:
    """Return a greenish pane over the whole leaf, with a bright and a dark edge."""
    reach = tf.reduce_max(tf.abs(context.outline), axis=0) * 1.1 + pane.pane_margin_mm
    corners = turn_points(UNIT_SQUARE * reach, 0.2 * pane.turn)
    ring = tf.concat([corners, corners[:1]], axis=0)
    green = tf.stack([0.6 - 0.2 * numbers[0], 0.68 - 0.15 * numbers[0], 0.64 - 0.2 * numbers[0]])[
        :, None, None
    ]
    perimeter_mm = 8.8 * (_LARGEST_LEAF_MM / 2 + largest.pane_margin_mm)
    edges = [
        PropShape(
            stroke_outlines(ring + shift, tf.fill([5], 0.8)), tf.fill([3, 1, 1], grey), 2 * perimeter_mm, 0.4
        )
        for shift, grey in ((0.5, 0.15), (0.0, 0.95))
    ]
    return [PropShape(corners, green, perimeter_mm, opacity=pane.pane_opacity), *edges]
