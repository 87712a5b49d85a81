"""The parameters of all stages of the reader of rulings, apart from the stages, which need TensorFlow."""

from dataclasses import dataclass, field

import numpy as np

from laesi_tf.estimators.parameters import RENDERED, RENDERED_AND_CASES, parameter
from laesi_tf.estimators.ruling.scale_error import ScaleErrorParams

_SCENES_78 = "160 phone scenes of millimetre paper (1,024 px, seed 78), 2026-11-30"
_WIDE = 1e4
"""Standard deviation of a parameter that nothing is known of."""


@dataclass(frozen=True, kw_only=True)
class VoteParams:
    """Parameters of the votes of cells."""

    sure: float = parameter(0.5, unit="probability", set_on=RENDERED)
    """From it a cell counts as readable."""
    agreeing_bins: float = parameter(2.4, unit="bins of 8.7 %", set_on=RENDERED)
    """Cells whose period lies within this many bins of the winner's agree with it."""
    apart_bins: int = parameter(4, unit="bins of 8.7 %", set_on=RENDERED)
    """A rival period is farther from the winner than this."""
    apart_share: float = parameter(0.4, unit="share of a window's side", set_on=RENDERED)
    """Middles of two windows are at least this far apart."""
    smoothing_cells: int = parameter(5, unit="cells of the frame", set_on=RENDERED)
    """Side of the square over which local periods and directions are averaged."""


@dataclass(frozen=True, kw_only=True)
class SearchParams:
    """Parameters of the search for the waves of both families near the cells' answers."""

    ratio_reach: float = parameter(0.21, unit="ln of frequency", set_on=RENDERED)
    """A family's frequency lies within this of what the cells say: unequal pitches differ by 0.22."""
    ratio_steps: int = parameter(43, unit="steps", set_on=RENDERED)
    turn_reach: float = parameter(0.14, unit="radians", set_on=RENDERED)
    """Greatest angle between the direction that cells say and the lines."""
    turn_steps: int = parameter(9, unit="steps", set_on=RENDERED)
    common_spread: float = parameter(0.05, unit="ln of frequency", set_on=RENDERED)
    """Standard deviation of the families' mean frequency about the cells' answer."""
    unequal_spread: float = parameter(0.08, unit="ln of frequency", set_on=RENDERED)
    """The same of half the difference between the families, where photos may be stretched."""
    equal_spread: float = parameter(0.02, unit="ln of frequency", set_on=RENDERED)
    """The same where pixels are square."""
    peak_reach: float = parameter(0.06, unit="ln of frequency", set_on=RENDERED)
    """A window's own peak lies within this of what all windows say; 4/5 and 6/5 waves stay outside."""


@dataclass(frozen=True, kw_only=True)
class WaveParams:
    """Parameters of the waves that are measured."""

    frequency_floor: float = parameter(0.0015, unit="share of the frequency", set_on=RENDERED)
    """Error of a window's frequency that no signal removes: uneven print and paper."""
    phase_floor: float = parameter(0.012, unit="periods", set_on=RENDERED)
    """The same of a phase."""
    faintest: float = parameter(6.0, unit="power over the noise", set_on=RENDERED)
    """A wave counts from this power."""


@dataclass(frozen=True, kw_only=True)
class FitParams:
    """Parameters of the fit of a sheet."""

    waves: WaveParams = field(default_factory=WaveParams)
    tilt_prior: float = parameter(0.3, unit="share of the camera's distance", set_on=RENDERED)
    """Standard deviation of its change over half the longer side, which the tilt makes."""
    k1_prior: float = parameter(0.04, unit="share of the radius", set_on=RENDERED)
    """Standard deviation of radial distortion at half the longer side from the middle: phones have up to
    0.05."""
    centre_prior: float = parameter(0.3, unit="half the longer side", set_on=RENDERED)
    """Standard deviation of the centre of distortion: photos are cropped."""
    agreeing_phase: float = parameter(0.06, unit="periods", set_on=RENDERED)
    """A window agrees with the fit if its lines are this near to the fitted ones, or within four medians."""
    correlation: float = parameter(4.0, unit="windows", set_on=RENDERED)
    """Windows overlap and waves of the paper move neighbours together: so many windows count as one."""
    least_variance: float = parameter(0.05, unit="normalised residuals squared", set_on=RENDERED)
    """Least variance of the residuals: fewer windows than parameters must not seem perfect."""
    bend_prior: float = parameter(0.02, unit="share of the camera's distance", set_on=RENDERED)
    """Standard deviation of the sheet's rise at half the longer side from the middle."""

    @property
    def priors(self) -> np.ndarray:
        """Standard deviations [COUNT] of the sheet's parameters about 0."""
        return np.array(
            [_WIDE] * 6
            + [self.tilt_prior] * 2
            + [self.k1_prior]
            + [self.centre_prior] * 2
            + [self.bend_prior] * 3,
            np.float32,
        )


@dataclass(frozen=True, kw_only=True)
class LevelParams:
    """Parameters of the decision which lines are printed."""

    excess: float = parameter(0.45, unit="ln of amplitude", set_on=RENDERED_AND_CASES)
    """A wave's amplitude over what its neighbours make one expect, mean of both families, from which finer
    lines are printed. Lines of a tenth of the heavy ones' ink give 0.44 at order 5."""
    clear: float = parameter(4.0, unit="standard errors", set_on=RENDERED_AND_CASES)
    """A coherent amplitude at which the wave is there."""
    excluded: float = parameter(0.3, unit="share of the expected amplitude", set_on=RENDERED_AND_CASES)
    """Standard error below which finer lines are excluded where they have no excess."""
    heavy: float = parameter(8.0, unit="power over its standard error", set_on=RENDERED_AND_CASES)
    """Mean of the waves that heavier lines make; 1 on average without any, and up to 5 where few windows
    overlap much."""
    harmonic: float = parameter(20.0, unit="power over its standard error", set_on=RENDERED_AND_CASES)
    """The same for one family's waves at quarters or sixths, from which it is taken to be fitted to a
    harmonic."""
    fifth_excess: float = parameter(0.22, unit="ln of amplitude", set_on=RENDERED_AND_CASES)
    """What waves at fifths exceed those at tenths by where every fifth line is heavier, not only tenths."""
    half_excess: float = parameter(0.2, unit="ln of amplitude", set_on=_SCENES_78)
    """What a wave at the half exceeds its neighbours by where it is the finest lines': -0.3 to 0.14 where
    tenths are heavier, 0.36 where fives were read as tens."""
    own_excess: float = parameter(0.12, unit="ln of amplitude", set_on=_SCENES_78)
    """What the finest lines' wave exceeds the harmonics of heavier fives by: 0.33 to 2.7 where they are seen,
    0.03 where they are too fine."""
    smooth: float = parameter(0.25, unit="ln of amplitude", set_on=RENDERED_AND_CASES)
    """Second differences along the harmonics of lines with nothing between them; 0.05 on drawn squares."""
    highest: float = parameter(0.47, unit="periods per pixel", set_on=RENDERED_AND_CASES)
    """Highest frequency that is asked."""


@dataclass(frozen=True, kw_only=True)
class ReadingParams:
    """Parameters of a reading and its stages."""

    votes: VoteParams = field(default_factory=VoteParams)
    search: SearchParams = field(default_factory=SearchParams)
    fit: FitParams = field(default_factory=FitParams)
    levels: LevelParams = field(default_factory=LevelParams)
    coarsest_px: float = parameter(
        10.0, unit="pixels of the level", set_on="periods of 5 to 10 pixels at the windows' level, 2026-11-29"
    )
    """Windows are cut at the finest level whose period is at most this."""
    room_px: float = parameter(256.0, unit="pixels of the level", set_on="twice a window's side, 2026-11-29")
    """The photo's shorter side has at least this many pixels at the windows' level."""
    same_factors: float = parameter(0.03, unit="ln of frequency", set_on="data not recorded, 2026-11-29")
    """Difference of the families' factors up to which two readings are one."""


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
    surely_finest_px: float = parameter(
        3.3, unit="frame pixels", set_on="rendered (split develop) at a quarter of its pixels, 2026-11-29"
    )
    """Lines of which every fifth alone is heavier are not believed below this distance."""
    sure_fifths: float = parameter(
        200.0,
        unit="power over its standard error",
        set_on="the same photos: 11 to 80; over 1,000 on scenes of such paper at 3 pixels, 2026-11-29",
    )
    """Unless the waves of heavier fifths are so strong in both families."""
    widest_mm: float = parameter(700.0, unit="mm", set_on=RENDERED_AND_CASES)
    """Photos do not show more of a sheet: A3 with a margin, held at arm's length."""


@dataclass(frozen=True, kw_only=True)
class RulingReaderParams:
    """Parameters of the reader's stages, in the order in which they run."""

    resolution: ResolutionParams = field(default_factory=ResolutionParams)
    reading: ReadingParams = field(default_factory=ReadingParams)
    judge: JudgeParams = field(default_factory=JudgeParams)
    sheet_agreement: float = parameter(
        0.3, unit="mean weight of agreeing cells", set_on="data not recorded, 2026-11-29"
    )
    """Cells of the frame whose agreement over levels is above this belong to the ruled sheet."""
