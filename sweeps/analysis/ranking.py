"""Compare how a small and a larger budget rank points, and rank the paper's optimum."""

import functools
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.point_errors import geometric_means
from sweeps.trials.search_space import OPTIMUM, POINTS

_RESAMPLES, _SEED, _CONFIDENCE = 2000, 0, 0.95
_COEFFICIENTS = {"Kendall's tau": stats.kendalltau, "Spearman's rho": stats.spearmanr}


@dataclass(frozen=True)
class RankCorrelation:
    """A rank correlation with its bootstrap interval over points."""

    name: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class RepeatedPoint:
    """A repeated point: its MRE in the screening and the geometric mean of the repeats, in percent."""

    number: int
    screened: float
    mre: float


@dataclass(frozen=True)
class Finalist(RepeatedPoint):
    """A finalist, and by how many percent its MRE is above that of the best.

    The interval of the difference is Tukey's, simultaneous over all pairs of finalists, as the best is
    selected by the same trials. If it includes zero the difference is not significant.
    """

    behind: float
    low: float
    high: float


def pair_with_screening(
    screened: Sequence[TrialRecord], records: Sequence[TrialRecord]
) -> list[RepeatedPoint]:
    """Return the points of `records` that were screened, in the order of their numbers."""
    before = {record.number: record.mre for record in screened}
    repeated = geometric_means((record.number, record.mre) for record in records if record.number in before)
    return [RepeatedPoint(number, before[number], mre) for number, mre in sorted(repeated.items())]


def compare_finalists(screened: Sequence[TrialRecord], records: Sequence[TrialRecord]) -> list[Finalist]:
    """Return the finalists from best to worst, without those that lack a replicate.

    The logarithms of their errors are modelled as an effect of the point plus one of the seed; the intervals
    come from the residual, pooled over all points.
    """
    repeated = {point.number: point for point in pair_with_screening(screened, records)}
    found = {(record.number, record.replicate): record.mre for record in records}
    seeds = sorted({replicate for _, replicate in found})
    numbers = [number for number in repeated if all((number, seed) in found for seed in seeds)]
    if not numbers:
        return []
    table = np.log([[found[number, seed] for seed in seeds] for number in numbers])
    means = table.mean(axis=1)
    residuals = table - means[:, None] - table.mean(axis=0) + table.mean()
    degrees_of_freedom = (len(numbers) - 1) * (len(seeds) - 1)
    margin = np.inf
    if degrees_of_freedom:
        error = np.sqrt(np.sum(residuals**2) / degrees_of_freedom / len(seeds))
        margin = error * _studentized_range_quantile(len(numbers), degrees_of_freedom)
    behind = means - means.min()

    def percent(log_ratio: float) -> float:
        return float(100 * (np.exp(log_ratio) - 1))

    return [
        Finalist(
            number=numbers[index],
            screened=repeated[numbers[index]].screened,
            mre=repeated[numbers[index]].mre,
            behind=percent(behind[index]),
            low=percent(behind[index] - margin),
            high=percent(behind[index] + margin),
        )
        for index in np.argsort(means, kind="stable")
    ]


def rank_correlations(points: Sequence[RepeatedPoint]) -> list[RankCorrelation]:
    """Return Kendall's tau and Spearman's rho between the screening and the larger budget.

    The intervals are percentiles of a bootstrap over points; resamples of one single point have no
    correlation and are left out.
    """
    return [_correlate(points, name, coefficient) for name, coefficient in _COEFFICIENTS.items()]


def _correlate(
    points: Sequence[RepeatedPoint], name: str, coefficient: Callable[..., Any]
) -> RankCorrelation:
    samples = [point.screened for point in points], [point.mre for point in points]

    def statistic(screened: np.ndarray, repeated: np.ndarray) -> float:
        return float(coefficient(screened, repeated).statistic)

    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        warnings.simplefilter("ignore", stats.ConstantInputWarning)
        resampled = stats.bootstrap(
            samples,
            statistic,
            paired=True,
            vectorized=False,
            n_resamples=_RESAMPLES,
            method="percentile",
            rng=np.random.default_rng(_SEED),
        ).bootstrap_distribution
    low, high = np.nanquantile(resampled, [(1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2])
    return RankCorrelation(name, statistic(*map(np.asarray, samples)), float(low), float(high))


@functools.cache
def _studentized_range_quantile(groups: int, degrees_of_freedom: int) -> float:
    """Return the quantile of Tukey's test; SciPy takes a good part of a second for it."""
    return float(stats.studentized_range.ppf(_CONFIDENCE, groups, degrees_of_freedom))


def rank_of_optimum(records: Sequence[TrialRecord]) -> tuple[int, int]:
    """Return the rank of the paper's optimum among `records`, from 1, and their number."""
    optimum = POINTS.index(OPTIMUM)
    (mre,) = (record.mre for record in records if record.number == optimum)
    return 1 + sum(record.mre < mre for record in records), len(records)
