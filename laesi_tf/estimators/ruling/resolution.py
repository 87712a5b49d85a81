"""Decide whether a photo's ruling has to be looked at in full resolution."""

from dataclasses import dataclass

import tensorflow as tf

from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.ruling.votes import Votes
from laesi_tf.models.ruling_cells import DIRECTION_BINS, FRAME_CELLS, PERIOD_BINS, CellAnswers


@dataclass(frozen=True, kw_only=True)
class ResolutionParams:
    """Parameters of the choice of the resolution."""

    enough_cells: int = parameter(40, unit="cells", set_on="data not recorded, 2026-11-29")
    """So many readable cells at a coarse level make the full resolution superfluous."""
    many_hidden: float = parameter(
        0.2, unit="share of the readable cells", set_on="data not recorded, 2026-11-29"
    )
    """From so many cells on that may hide finer lines the full resolution is needed."""
    fine_period_px: float = parameter(9.0, unit="frame pixels", set_on="cases, 2026-11-29")
    """Coarse levels do not suffice for shorter periods: thin lines that are averaged to less than 4.5 pixels
    per period make others appear."""


def needs_full_resolution(
    coarse: list[CellAnswers], votes: Votes, params: ResolutionParams, *, sure: float
) -> tf.Tensor:
    """Return whether the coarse levels show too few lines, lines too fine for them, or lines that may hide
    finer ones.

    `coarse` are the answers of all levels but the first, `votes` their votes; cells whose probability is
    above `sure` are readable.
    """
    readable = [tf.cast(cells.readable > sure, tf.float32) for cells in coarse]
    counts = tf.stack([tf.reduce_sum(flags) for flags in readable])
    hidden = tf.stack(
        [tf.reduce_sum(flags * cells.finest_uncertain) for flags, cells in zip(readable, coarse, strict=True)]
    )
    best = tf.argmax(counts)
    is_unsure = (counts[best] < params.enough_cells) | (hidden[best] > params.many_hidden * counts[best])
    return is_unsure | (votes.period_px < params.fine_period_px)


def no_answers() -> CellAnswers:
    """Return the answers of a full resolution that is not looked at: no cell is readable."""
    cells: list[int] = [FRAME_CELLS, FRAME_CELLS]
    return CellAnswers(
        readable=tf.zeros(cells),
        periods=tf.zeros([*cells, PERIOD_BINS]),
        directions=tf.zeros([*cells, DIRECTION_BINS]),
        finest_uncertain=tf.zeros(cells),
    )
