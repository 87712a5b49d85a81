"""Decide what a reading is worth: a camera with the pitch of its lines, or a refusal that says what would
help.

The decision is `verdict.decide_refusal`; here its codes become sentences and a camera.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from laesi_tf.common.arrays import Mask, Points
from laesi_tf.estimators.photo_pyramid import Crop
from laesi_tf.estimators.ruling.codes import HEAVIER_LEVELS, PitchNote, Refusal
from laesi_tf.estimators.ruling.scale_error import ScaleErrorParams
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera

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
    part: Crop | None = None
    """What was looked at: the photo's overview, or a part of it."""
    ruled_cells: Mask | None = None
    """bool [C, C], cells of CELL_PX pixels of `part` that show the ruling."""

    @property
    def proves_millimetres(self) -> bool:
        """Whether fifth and tenth lines are heavier, as on millimetre paper alone."""
        return self.paper == _MILLIMETRE_PAPER


def name_paper(heavier: Sequence[bool]) -> str:
    """Return which lines are heavier, counted in finest lines; `heavier` [4] is by `HEAVIER_LEVELS`."""
    levels = [level for level, flag in zip(HEAVIER_LEVELS, heavier, strict=True) if flag]
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


def judge_verdict(
    verdict: Mapping[str, Any],
    size: tuple[int, int],
    step: tuple[float, float],
    *,
    grid_mm: float | None,
    scale_error: ScaleErrorParams,
) -> SheetReading:
    """Return the camera that follows from a `verdict`, see `verdict.state_verdict`, or why there is none.

    `size` is the photo's (height, width) in frame pixels and `step` the photo pixels per frame pixel, (x, y).
    `grid_mm` is the distance of the finest lines where the user names it; None takes the lines for
    millimetres if heavier ones speak for it.
    """
    refusal, paper = Refusal(int(verdict["refusal"])), name_paper([bool(x) for x in verdict["heavier"]])
    if refusal != Refusal.NONE:
        period = float(verdict["period_px"]) * float(np.sqrt(step[0] * step[1]))
        text = SENTENCES[refusal].format(period=period, grid=grid_mm)
        is_fitted = refusal not in (Refusal.NO_RULING, Refusal.ONE_DIRECTION, Refusal.NOT_A_SHEET)
        return SheetReading(refusal=text, paper=paper if is_fitted else "")
    camera = SheetCamera(
        np.asarray(verdict["parameters"], float),
        np.asarray(verdict["covariance"], float),
        size,
        step,
        1.0 if grid_mm is None else grid_mm,
        float(verdict["phase_error"]),
        scale_error,
    )
    note = PitchNote(int(verdict["note"]))
    notes = (NOTES[note],) if note != PitchNote.NONE else ()
    return SheetReading(camera=camera, notes=notes, paper=paper)
