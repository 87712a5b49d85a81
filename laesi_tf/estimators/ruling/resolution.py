"""Decide whether a photo's ruling has to be looked at in full resolution."""

import tensorflow as tf

from laesi_tf.estimators.ruling.params import ResolutionParams
from laesi_tf.estimators.ruling.votes import Votes
from laesi_tf.models.ruling_cells import DIRECTION_BINS, FRAME_CELLS, PERIOD_BINS, CellAnswers


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
