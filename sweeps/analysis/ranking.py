"""Compare how a small and a larger budget rank points, and rank the paper's optimum."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import OPTIMUM, POINTS

_RESAMPLED, _SEED, _CONFIDENCE = 2000, 0, 0.95


@dataclass(frozen=True)
class RankCorrelation:
    """A rank correlation with its bootstrap interval over points."""

    name: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class RepeatedPoint:
    """A point tried again: its MRE in the screening, and that of now, the geometric mean over seeds."""

    number: int
    screened: float
    mre: float


@dataclass(frozen=True)
class Finalist(RepeatedPoint):
    """A finalist, and how much worse it is than the best, %.

    The interval of the difference is one of Tukey's, simultaneous over all pairs of finalists: which is best
    is found from the same trials. Where it reaches below zero the finalist may be the better one.
    """

    behind: float
    low: float
    high: float


def pair_with_screening(screened: Sequence[TrialRecord], rows: Sequence[TrialRecord]) -> list[RepeatedPoint]:
    """The points of `rows`, in the order of their numbers."""
    before = {row.number: row.mre for row in screened}
    logs: dict[int, list[float]] = {}
    for row in rows:
        logs.setdefault(row.number, []).append(np.log(row.mre))
    return [
        RepeatedPoint(number, before[number], float(np.exp(np.mean(own))))
        for number, own in sorted(logs.items())
    ]


def compare_finalists(screened: Sequence[TrialRecord], rows: Sequence[TrialRecord]) -> list[Finalist]:
    """The finalists from best to worst, without those that lack a replicate, as they may still be tried.

    Their errors are logarithms with an effect of the point and one of the seed; what is left over, pooled
    over all of them, is the chance that intervals are made from.
    """
    found = {(row.number, row.replicate): row.mre for row in rows}
    seeds = sorted({replicate for _, replicate in found})
    numbers = sorted({row.number for row in rows if all((row.number, seed) in found for seed in seeds)})
    if not numbers:
        return []
    table = np.log([[found[number, seed] for seed in seeds] for number in numbers])
    means = table.mean(axis=1)
    left_over = table - means[:, None] - table.mean(axis=0) + table.mean()
    freedom = (len(numbers) - 1) * (len(seeds) - 1)
    reach = np.inf
    if freedom:
        chance = np.sqrt(np.sum(left_over**2) / freedom / len(seeds))
        reach = chance * stats.studentized_range.ppf(_CONFIDENCE, len(numbers), freedom)
    tried = {one.number: one for one in pair_with_screening(screened, rows)}
    order = np.argsort(means, kind="stable")
    behind = means - means[order[0]]

    def percent(log: float) -> float:
        return float(100 * (np.exp(log) - 1))

    return [
        Finalist(
            number=numbers[place],
            screened=tried[numbers[place]].screened,
            mre=tried[numbers[place]].mre,
            behind=percent(behind[place]),
            low=percent(behind[place] - reach),
            high=percent(behind[place] + reach),
        )
        for place in order
    ]


def rank_correlations(found: Sequence[RepeatedPoint]) -> list[RankCorrelation]:
    """Kendall's tau and Spearman's rho between the screening and the larger budget."""
    pairs = np.array([(final.screened, final.mre) for final in found])
    random = np.random.default_rng(_SEED)
    draws = random.integers(0, len(pairs), (_RESAMPLED, len(pairs)))
    made = []
    for name, correlation in (("Kendall's tau", stats.kendalltau), ("Spearman's rho", stats.spearmanr)):
        with np.errstate(invalid="ignore"):
            values = [correlation(*pairs[draw].T).statistic for draw in draws]
        low, high = np.nanpercentile(values, [50 * (1 - _CONFIDENCE), 50 * (1 + _CONFIDENCE)])
        made.append(RankCorrelation(name, float(correlation(*pairs.T).statistic), float(low), float(high)))
    return made


def rank_of_optimum(rows: Sequence[TrialRecord]) -> tuple[int, int]:
    """Place of the paper's optimum among `rows`, from 1, and how many there are."""
    optimum = POINTS.index(OPTIMUM)
    (own,) = (row.mre for row in rows if row.number == optimum)
    return 1 + sum(row.mre < own for row in rows), len(rows)
