"""What the ruling network says about every cell of a photo, and the scale of its period bins.

The photo lies in the upper left corner of a square frame of FRAME_PX pixels; level l of its pyramid is the
frame averaged over squares of 2^l pixels. A cell covers CELL_PX x CELL_PX pixels of its level.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import tensorflow as tf

FRAME_PX = 1536
LEVELS = 4
CELL_PX = 16
FRAME_CELLS = FRAME_PX // CELL_PX
FINEST_PX = 1.5
"""Pixels of a level per period at the first bin."""
BINS_PER_OCTAVE = 8
"""Whole, so that a period falls into the same bins of every level: level l is shifted by 8 l bins."""
PERIOD_BINS = 38
"""From 1.5 to 37 pixels per period."""
DIRECTION_BINS = 12
"""Of direction modulo 90 degrees: bin b is b * 7.5 degrees."""
VOTE_BINS = PERIOD_BINS + BINS_PER_OCTAVE * (LEVELS - 1)
LOG_STEP = math.log(2) / BINS_PER_OCTAVE


class CellAnswers(NamedTuple):
    """Probabilities for the cells [h, w] of one level; cells outside the photo have `readable` 0."""

    readable: "tf.Tensor"
    """[h, w], that a ruling of two crossing families can be read here."""
    periods: "tf.Tensor"
    """[h, w, PERIOD_BINS] of the finest visible period."""
    directions: "tf.Tensor"
    """[h, w, DIRECTION_BINS] of the direction of the lines modulo 90 degrees."""
    finest_uncertain: "tf.Tensor"
    """[h, w], that finer lines are printed here than can be seen."""
