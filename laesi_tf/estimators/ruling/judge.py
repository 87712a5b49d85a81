"""Decide what a reading is worth: a camera with the pitch of its lines, or a refusal that says what would
help."""

from dataclasses import dataclass

import numpy as np

from laesi_tf.common.arrays import Points
from laesi_tf.estimators.ruling.reading import Reading
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera


@dataclass(frozen=True)
class JudgeParameters:
    """Set on 28 November 2026 on `rendered` (split develop), `cases` and every ninth photo of semireal's
    train."""

    fewest_cells: float = 12
    """Cells of one level that agree on the period; unruled photos of `cases` have at most 8."""
    fewest_windows: int = 4
    """Windows in which both families agree with the fit."""
    faintest: float = 6.0
    """Median power of a family's waves over the noise; lines in one direction give 1 for the other."""
    worst_phase: float = 0.05
    """Median distance of the lines from the fit, periods; 0.03 on the worst of the right ones."""


PARAMETERS = JudgeParameters()
NO_RULING = "no ruling of two crossing families of lines is seen; show bare, sharp paper around the leaf"
ONE_DIRECTION = "lines run in one direction only, {period:.1f} px apart; use paper with squares"
NOT_A_SHEET = "the lines do not fit one sheet of paper; lay it flat and photograph it from above"
FINEST_UNCERTAIN = (
    "lines {period:.1f} px apart are read, but finer ones between them could not be seen; go closer, or name "
    "the distance of these lines with --grid-mm"
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
    proves_millimetres: bool = False
    """Fifth and tenth lines are heavier, as on millimetre paper alone."""


def name_paper(reading: Reading) -> str:
    """Which lines are heavier, counted in finest lines."""
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


def judge_reading(
    reading: Reading, size: tuple[int, int], step: tuple[float, float], *, grid_mm: float | None
) -> SheetReading:
    """The camera that `reading` founds, or why there is none.

    `size` is the photo's (height, width) in frame pixels and `step` the photo pixels per frame pixel, (x, y).
    `grid_mm` is the distance of the finest lines where the user names it; None takes the lines for
    millimetres if heavier ones speak for it.
    """
    p, fit = PARAMETERS, reading.fit
    period = float(reading.votes.period_px / reading.finer.factor) * float(np.sqrt(step[0] * step[1]))
    if float(reading.votes.agreeing_cells) < p.fewest_cells:
        return SheetReading(refusal=NO_RULING)
    weaker, stronger = sorted(float(value) for value in fit.signal)
    if weaker < p.faintest:
        both = stronger < 5 * p.faintest
        return SheetReading(refusal=NO_RULING if both else ONE_DIRECTION.format(period=period))
    if int(fit.windows) < p.fewest_windows or float(fit.phase_error) > p.worst_phase:
        return SheetReading(refusal=NOT_A_SHEET)
    paper = name_paper(reading)
    if grid_mm is None and paper in ("1", "1-2", "1-4"):
        excluded = bool(reading.finer.excluded[1])
        uncertain = (paper == "1-2" or not excluded) and float(reading.finer.factor) < 1.5
        text = FINEST_UNCERTAIN if uncertain else PITCH_UNKNOWN
        return SheetReading(refusal=text.format(period=period), paper=paper)
    camera = SheetCamera(
        np.asarray(fit.parameters, float),
        np.asarray(fit.covariance, float),
        size,
        step,
        1.0 if grid_mm is None else grid_mm,
        float(fit.phase_error),
    )
    ambiguous = {"1-10": AMBIGUOUS_TENTH, "1-5": AMBIGUOUS_FIFTH}
    notes = (ambiguous[paper],) if grid_mm is None and paper in ambiguous else ()
    return SheetReading(camera=camera, notes=notes, paper=paper, proves_millimetres=paper == "1-5-10")
