"""The kinds of ruled and unruled paper, and which lines a sheet has.

All families of a kind repeat after one period, in which each has a whole number of lines.
"""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis.paper.params import KIND_NAMES, PaperParams
from laesi_tf.synthesis.ranges import Scalar


class PaperKind(NamedTuple):
    """One kind of paper.

    `lines_per_period` of the fine, medium and heavy family; 0 where a family does not exist.
    """

    period_mm: float
    lines_per_period: tuple[int, int, int]
    is_crossed: bool = True
    """Lines run in both directions."""


INCH_MM = 25.4
PHASE_PERIOD_MM = 10
"""`PaperParams.phase_*` of this many mm are a whole period of any kind."""
PAPER_KINDS = {
    # Which of its heavier families a sheet has is sampled: 1-5-10, 1-10 and 1-5 mm.
    "millimetre": PaperKind(10, (10, 2, 1)),
    "mm_1_2_10": PaperKind(10, (10, 5, 1)),
    "mm_2_10": PaperKind(10, (5, 0, 1)),
    "mm_4": PaperKind(4, (1, 0, 0)),
    "mm_5": PaperKind(5, (1, 0, 0)),
    "quarter_inch": PaperKind(INCH_MM, (4, 0, 1)),
    "tenth_inch": PaperKind(INCH_MM, (10, 2, 1)),
    # The period of `lines` is sampled, `PaperParams.spacing_mm`.
    "lines": PaperKind(10, (1, 0, 0), is_crossed=False),
    "plain": PaperKind(10, (0, 0, 0)),
}
"""By name, in the order of `KIND_NAMES`."""
_KINDS = [PAPER_KINDS[name] for name in KIND_NAMES]
LONGEST_PERIOD_MM = max(kind.period_mm for kind in _KINDS)


class PrintedLines(NamedTuple):
    """The lines of one sheet: `period_mm` [] after which all families repeat, `per_period` [3] lines of the
    fine, medium and heavy family, 0 for those that the sheet lacks; `is_crossed` bool []."""

    period_mm: tf.Tensor
    per_period: tf.Tensor
    is_crossed: tf.Tensor


def printed_lines(paper: PaperParams[Scalar]) -> PrintedLines:
    """Return the lines that a sheet has."""
    kind = tf.cast(paper.kind, tf.int32)
    per_period = tf.gather(tf.constant([kind.lines_per_period for kind in _KINDS], tf.float32), kind)
    is_crossed = tf.gather(tf.constant([kind.is_crossed for kind in _KINDS]), kind)
    period_mm = tf.gather(tf.constant([kind.period_mm for kind in _KINDS], tf.float32), kind)
    # With neither heavier family, paper of three families would be a plain 1 mm grid, which is not sold.
    has_heavy = paper.has_10mm | (~paper.has_5mm & (per_period[1] > 0))
    present = tf.stack([tf.constant(True), paper.has_5mm, has_heavy])
    return PrintedLines(
        tf.where(is_crossed, period_mm, paper.spacing_mm),
        per_period * tf.cast(present, tf.float32),
        is_crossed,
    )


def spacing_mm(paper: PaperParams[Scalar]) -> tf.Tensor:
    """Return the distance in mm of the finest lines, in one direction or two: []; any for plain sheets."""
    lines = printed_lines(paper)
    return lines.period_mm / tf.maximum(lines.per_period[0], 1)


def crossed_periods_mm(paper: PaperParams[Scalar]) -> tf.Tensor:
    """Return the periods in mm of the fine, medium and heavy family that cross another: [3], 0 for none."""
    lines = printed_lines(paper)
    return tf.math.divide_no_nan(lines.period_mm, lines.per_period) * tf.cast(lines.is_crossed, tf.float32)


def place_in_period(paper: PaperParams[Scalar], x_mm: tf.Tensor, y_mm: tf.Tensor) -> tf.Tensor:
    """Return the places [2, ...] on the sheet in periods: at whole numbers lies a line of all families."""
    per_mm = 1 / printed_lines(paper).period_mm
    phases = (paper.phase_x, paper.phase_y)
    places = zip((x_mm, y_mm), phases, strict=True)
    return tf.stack([place * per_mm + phase / PHASE_PERIOD_MM for place, phase in places])
