"""Decide what a reading is worth: a camera with the pitch of its lines, or a refusal that says what would
help."""

import math
from dataclasses import dataclass, field

import numpy as np

from laesi_tf.common.arrays import Points
from laesi_tf.common.sheet_model import SheetModel
from laesi_tf.estimators.parameters import RENDERED_AND_CASES, parameter
from laesi_tf.estimators.ruling.line_levels import FINER
from laesi_tf.estimators.ruling.reading import Reading
from laesi_tf.estimators.ruling.sheet_camera import ScaleErrorParams, SheetCamera


@dataclass(frozen=True, kw_only=True)
class JudgeParams:
    """Parameters of the judgement."""

    scale_error: ScaleErrorParams = field(default_factory=ScaleErrorParams)
    fewest_cells: int = parameter(12, unit="cells", set_on=RENDERED_AND_CASES)
    """Cells of one level that agree on the period; unruled photos of `cases` have at most 8."""
    fewest_windows: int = parameter(4, unit="windows", set_on=RENDERED_AND_CASES)
    """Windows in which both families agree with the fit."""
    faintest: float = parameter(6.0, unit="power over the noise", set_on=RENDERED_AND_CASES)
    """Median of a family's waves; lines in one direction give 1 for the other."""
    worst_phase: float = parameter(0.05, unit="periods", set_on=RENDERED_AND_CASES)
    """Median distance of the lines from the fit; 0.03 on the worst of the right ones."""
    rival_share: float = parameter(0.5, unit="share of the votes", set_on=RENDERED_AND_CASES)
    """Votes for lines that are finer than the fitted by a whole factor, over those for the fitted ones, from
    which these are not believed."""
    same_period: float = parameter(0.07, unit="ln of period", set_on=RENDERED_AND_CASES)
    """Periods that differ by less are the same."""
    same_pitch: float = parameter(0.2, unit="ln of distance", set_on="printers scale by 3 %, 2026-11-29")
    """A named distance of lines that prove millimetre paper differs from a millimetre by at most so much."""
    always_finest_mm: float = parameter(3.0, unit="mm", set_on=RENDERED_AND_CASES)
    """Squares of a named distance from this on have no heavier lines that can pass for them."""
    widest_mm: float = parameter(700.0, unit="mm", set_on=RENDERED_AND_CASES)
    """Photos do not show more of a sheet: A3 with a margin, held at arm's length."""


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


def votes_for_finer(reading: Reading, params: JudgeParams) -> bool:
    """Return whether many cells vote for lines between those that were fitted, which may not be excluded."""
    votes, finer = reading.votes, reading.finer
    orders = np.array(FINER)[~np.asarray(finer.excluded, bool)] / float(finer.factor)
    apart = np.abs(np.log(float(votes.period_px) / float(votes.rival_px) / orders[orders > 1]))
    is_multiple = bool((apart < params.same_period).any())
    return is_multiple and float(votes.rival_share) > params.rival_share


def is_before_camera(parameters: np.ndarray, covariance: np.ndarray, size: tuple[int, int]) -> bool:
    """Return whether the fit is finite and the plane's horizon lies outside a photo of `size` (height,
    width)."""
    if not (np.isfinite(parameters).all() and np.isfinite(covariance).all()):
        return False
    model = SheetModel(*parameters)
    across, down = size[1] / max(size), size[0] / max(size)
    return bool(abs(model.tilt_x) * across + abs(model.tilt_y) * down < 1)


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
    period = float(reading.votes.period_px / reading.finer.factor) * float(np.sqrt(step[0] * step[1]))
    if float(reading.votes.agreeing_cells) < params.fewest_cells:
        return SheetReading(refusal=NO_RULING)
    weaker, stronger = sorted(float(value) for value in fit.signal)
    if weaker < params.faintest:
        are_both_faint = stronger < 5 * params.faintest
        return SheetReading(refusal=NO_RULING if are_both_faint else ONE_DIRECTION.format(period=period))
    if int(fit.windows) < params.fewest_windows or float(fit.phase_error) > params.worst_phase:
        return SheetReading(refusal=NOT_A_SHEET)
    if not is_before_camera(np.asarray(fit.parameters), np.asarray(fit.covariance), size):
        return SheetReading(refusal=NOT_A_SHEET)
    paper = name_paper(reading)
    if paper == _MILLIMETRE_PAPER and grid_mm is not None and abs(math.log(grid_mm)) > params.same_pitch:
        return SheetReading(refusal=CONTRADICTED.format(grid=grid_mm), paper=paper)
    if paper != _MILLIMETRE_PAPER and votes_for_finer(reading, params):
        return SheetReading(refusal=FINER_VOTED.format(period=period), paper=paper)
    if paper in ("1", "1-2", "1-4"):
        excluded = bool(reading.finer.excluded[1])
        uncertain = (paper == "1-2" or not excluded) and float(reading.finer.factor) < 1.5
        if grid_mm is None:
            text = FINEST_UNCERTAIN if uncertain else PITCH_UNKNOWN
            return SheetReading(refusal=text.format(period=period), paper=paper)
        view_mm = grid_mm * max(size) * float(reading.finer.factor) / float(reading.votes.period_px)
        # Lines of which only every fifth or every tenth was seen show a wider view than it seems.
        may_be_heavier = any(
            (paper == "1-2" or not excluded) and order * view_mm < params.widest_mm
            for order, excluded in zip(FINER[1:], reading.finer.excluded[1:], strict=True)
        )
        if may_be_heavier and float(reading.finer.factor) < 1.5 and grid_mm < params.always_finest_mm:
            return SheetReading(refusal=NAMED_UNCERTAIN.format(period=period, grid=grid_mm), paper=paper)
    camera = SheetCamera(
        np.asarray(fit.parameters, float),
        np.asarray(fit.covariance, float),
        size,
        step,
        1.0 if grid_mm is None else grid_mm,
        float(fit.phase_error),
        params.scale_error,
    )
    ambiguous = {"1-10": AMBIGUOUS_TENTH, "1-5": AMBIGUOUS_FIFTH}
    notes = (ambiguous[paper],) if grid_mm is None and paper in ambiguous else ()
    return SheetReading(camera=camera, notes=notes, paper=paper)
