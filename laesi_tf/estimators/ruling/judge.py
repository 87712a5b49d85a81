"""Decide what a reading is worth: a camera with the pitch of its lines, or a refusal that says what would
help.

The decision is `verdict.decide_refusal`; here its codes become sentences and a camera.
"""

from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.common.arrays import Points
from laesi_tf.estimators.ruling.reading import Reading
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera
from laesi_tf.estimators.ruling.verdict import (
    JudgeParams,
    PitchNote,
    Refusal,
    decide_refusal,
    find_finest_period,
    note_pitch,
)

_MILLIMETRE_PAPER = "1-5-10"
"""Which lines are heavier on millimetre paper alone."""
NO_RULING = "no ruling of two crossing families of lines is seen; show bare, sharp paper around the leaf"
ONE_DIRECTION = "lines run in one direction only, {period:.1f} px apart; use paper with squares"
NOT_A_SHEET = "the lines do not fit one sheet of paper; lay it flat and photograph it from above"
FINEST_UNCERTAIN = (
    "lines {period:.1f} px apart are read, but finer ones between them could not be seen; go closer, or name "
    "the distance of these lines with --grid-mm"
)
FINER_VOTED = "lines {period:.1f} px apart are read, but finer ones between them show in places; go closer"
NAMED_UNCERTAIN = (
    "lines {period:.1f} px apart are read, but whether these or finer ones are {grid:g} mm apart could not "
    "be seen; go closer"
)
CONTRADICTED = (
    "every fifth and every tenth line is heavier, as on millimetre paper, but --grid-mm (column grid_mm of a "
    "manifest) is {grid:g}; name the distance of the finest lines"
)
PITCH_UNKNOWN = (
    "squares {period:.1f} px wide are read, without heavier lines that would tell their size; name it with "
    "--grid-mm"
)
AMBIGUOUS_TENTH = "every tenth line is heavier: millimetre paper, or tenths of an inch (--grid-mm 2.54)"
AMBIGUOUS_FIFTH = "every fifth line is heavier: millimetre paper, or 2 mm paper (--grid-mm 2)"


@dataclass(frozen=True, eq=False)
class SheetReading:
    """A camera or a refusal."""

    camera: SheetCamera | None = None
    refusal: str | None = None
    notes: tuple[str, ...] = ()
    paper: str = ""
    """Which lines are heavier: '1-5-10', '1-10', '1-5', '1-4', '1-2' or '1', in finest lines."""
    outline: Points | None = None
    """Convex outline [N, 2] of the ruled sheet as far as the photo shows it, photo pixels."""

    @property
    def proves_millimetres(self) -> bool:
        """Whether fifth and tenth lines are heavier, as on millimetre paper alone."""
        return self.paper == _MILLIMETRE_PAPER


def name_paper(reading: Reading) -> str:
    """Return which lines are heavier, counted in finest lines."""
    heavier = reading.heavier
    levels = [
        number
        for number, flag in (
            (2, heavier.second),
            (4, heavier.fourth),
            (5, heavier.fifth),
            (10, heavier.tenth),
        )
        if bool(flag)
    ]
    return "-".join(str(level) for level in (1, *levels))


SENTENCES = {
    Refusal.NO_RULING: NO_RULING,
    Refusal.ONE_DIRECTION: ONE_DIRECTION,
    Refusal.NOT_A_SHEET: NOT_A_SHEET,
    Refusal.CONTRADICTED: CONTRADICTED,
    Refusal.FINER_VOTED: FINER_VOTED,
    Refusal.FINEST_UNCERTAIN: FINEST_UNCERTAIN,
    Refusal.PITCH_UNKNOWN: PITCH_UNKNOWN,
    Refusal.NAMED_UNCERTAIN: NAMED_UNCERTAIN,
}
"""What each refusal of a ruling says to the user; with {period}, in photo pixels, and {grid}, in mm."""
NOTES = {PitchNote.TENTH: AMBIGUOUS_TENTH, PitchNote.FIFTH: AMBIGUOUS_FIFTH}
"""What each note says."""


def judge_reading(
    reading: Reading,
    size: tuple[int, int],
    step: tuple[float, float],
    *,
    grid_mm: float | None,
    params: JudgeParams,
) -> SheetReading:
    """Return the camera that follows from `reading`, or why there is none.

    `size` is the photo's (height, width) in frame pixels and `step` the photo pixels per frame pixel, (x, y).
    `grid_mm` is the distance of the finest lines where the user names it; None takes the lines for
    millimetres if heavier ones speak for it.
    """
    fit = reading.fit
    named, frame = tf.constant(grid_mm or 0.0, tf.float32), tf.constant(size, tf.float32)
    refusal = Refusal(int(decide_refusal(reading, frame, named, params=params)))
    if refusal != Refusal.NONE:
        period = float(find_finest_period(reading)) * float(np.sqrt(step[0] * step[1]))
        text = SENTENCES[refusal].format(period=period, grid=grid_mm)
        is_fitted = refusal not in (Refusal.NO_RULING, Refusal.ONE_DIRECTION, Refusal.NOT_A_SHEET)
        return SheetReading(refusal=text, paper=name_paper(reading) if is_fitted else "")
    camera = SheetCamera(
        np.asarray(fit.parameters, float),
        np.asarray(fit.covariance, float),
        size,
        step,
        1.0 if grid_mm is None else grid_mm,
        float(fit.phase_error),
        params.scale_error,
    )
    note = PitchNote(int(note_pitch(reading, named)))
    notes = (NOTES[note],) if note != PitchNote.NONE else ()
    return SheetReading(camera=camera, notes=notes, paper=name_paper(reading))
