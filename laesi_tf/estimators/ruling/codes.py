"""What graphs say about a photo, as numbers that stand in exported files."""

from enum import IntEnum


class Refusal(IntEnum):
    """Why a photo gets no areas; the numbers stand in exported files and are never reused."""

    NONE = 0
    NO_RULING = 1
    ONE_DIRECTION = 2
    NOT_A_SHEET = 3
    CONTRADICTED = 4
    FINER_VOTED = 5
    FINEST_UNCERTAIN = 6
    PITCH_UNKNOWN = 7
    NAMED_UNCERTAIN = 8
    NO_LEAF = 9
    NO_LEAF_ON_SHEET = 10
    MOSTLY_UNCOUNTED = 11


class PitchNote(IntEnum):
    """Doubts about what the lines' distance is."""

    NONE = 0
    TENTH = 1
    """Every tenth line is heavier: millimetre paper, or tenths of an inch."""
    FIFTH = 2
    """Every fifth line is heavier: millimetre paper, or 2 mm paper."""


HEAVIER_LEVELS = (2, 4, 5, 10)
"""Every which line may be heavier, in the order in which a verdict says whether it is."""
CUT_OFF = 1
"""In the `flags` of a leaf: the photo's border cuts it off."""
TOUCHED = 2
"""The same: something other than paper touches it."""
