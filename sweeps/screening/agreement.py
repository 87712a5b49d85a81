"""How well a candidate for the screening ranks the points of the reference, and what it does not rank."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sweeps.trials.search_space import FACTORS, POINTS

Errors = Mapping[int, float]
"""The MRE of each point in percent, by the point's number."""
_RESAMPLES, _CONFIDENCE, _SEED = 2000, 0.95, 0
_FEWEST_POINTS = 4
"""Points below which a rank correlation says nothing."""
_GAPS = ((0.0, 10.0), (10.0, 30.0), (30.0, np.inf))
"""Intervals of the difference between two points of the reference, in percent of the lower MRE."""


@dataclass(frozen=True)
class Tau:
    """Kendall's tau with its bootstrap interval over points; NaN for too few points."""

    value: float
    low: float
    high: float
    points: int

    def __str__(self) -> str:
        if np.isnan(self.value):
            return "too few points"
        return f"{self.value:.2f} [{self.low:.2f}, {self.high:.2f}]"


@dataclass(frozen=True)
class Agreement:
    """The agreement of a candidate with the reference: over all points, and over the better half of them."""

    all_points: Tau
    better_half: Tau


def measure_agreement(reference: Errors, candidate: Errors) -> Agreement:
    """Compare the ranks of the points that both have; the better half is that of the reference."""
    pairs = pair_errors(reference, candidate)
    return Agreement(kendall_tau(pairs), kendall_tau(pairs[: (len(pairs) + 1) // 2]))


def pair_errors(reference: Errors, candidate: Errors) -> np.ndarray:
    """Return the errors [N, 2] of the points that both have, from the best of the reference to its worst."""
    numbers = _rank_common(reference, candidate)
    return np.array([(reference[number], candidate[number]) for number in numbers]).reshape(-1, 2)


def _rank_common(reference: Errors, candidate: Errors) -> list[int]:
    return sorted(reference.keys() & candidate.keys(), key=lambda number: (reference[number], number))


def kendall_tau(pairs: np.ndarray) -> Tau:
    """Return Kendall's tau-b between the columns of `pairs` [N, 2], with a percentile interval."""
    if len(pairs) < _FEWEST_POINTS:
        return Tau(np.nan, np.nan, np.nan, len(pairs))
    samples = np.random.default_rng(_SEED).integers(0, len(pairs), (_RESAMPLES, len(pairs)))
    # Signs of all differences at once: tau-b is the correlation of these, and SciPy takes a second.
    signs = np.sign(pairs[:, None] - pairs[None])
    value = _tau_of_signs(signs)
    resampled = np.array([_tau_of_signs(signs[np.ix_(sample, sample)]) for sample in samples])
    low, high = np.nanquantile(resampled, [(1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2])
    return Tau(value, float(low), float(high), len(pairs))


def _tau_of_signs(signs: np.ndarray) -> float:
    """Return tau-b from the signs [N, N, 2] of differences; NaN where all points of a column are equal."""
    first, second = signs[..., 0], signs[..., 1]
    norm = np.sqrt(np.sum(first**2) * np.sum(second**2))
    return float(np.sum(first * second) / norm) if norm else np.nan


def share_of_ordered_pairs(reference: Errors, candidate: Errors) -> list[tuple[str, int, float]]:
    """Return (gap, pairs, share that the candidate orders as the reference does) by the reference's gap."""
    numbers = _rank_common(reference, candidate)
    ordered: dict[tuple[float, float], list[bool]] = {gap: [] for gap in _GAPS}
    for position, better in enumerate(numbers):
        for worse in numbers[position + 1 :]:
            difference = 100 * (reference[worse] / reference[better] - 1)
            gap = next(gap for gap in _GAPS if gap[0] <= difference < gap[1])
            ordered[gap].append(candidate[better] < candidate[worse])
    return [
        (
            f"{low:g} to {high:g} %" if np.isfinite(high) else f"over {low:g} %",
            len(pairs),
            float(np.mean(pairs)),
        )
        for (low, high), pairs in ordered.items()
        if pairs
    ]


def rank_shifts(reference: Errors, candidate: Errors) -> list[tuple[str, str, float, float]]:
    """Return (factor, level, mean shift in ranks, its standard error) of the candidate against the reference.

    Above zero: the candidate ranks the level worse. Levels that fewer than three points have are left out.
    """
    numbers = sorted(reference.keys() & candidate.keys())
    ranks = [stats.rankdata([errors[number] for number in numbers]) for errors in (reference, candidate)]
    shifts = dict(zip(numbers, ranks[1] - ranks[0], strict=True)) if numbers else {}
    found = []
    for factor, levels in FACTORS.items():
        for level in levels:
            values = [shifts[number] for number in numbers if POINTS[number].levels[factor] == level]
            if len(values) >= 3:
                error = float(np.std(values, ddof=1) / np.sqrt(len(values)))
                found.append((factor, level, float(np.mean(values)), error))
    return found


def choose_best(agreements: Mapping[str, Agreement], costs_s: Mapping[str, float], most_s: float) -> str:
    """Return the candidate with the highest tau of those that cost at most `most_s`; "" if there is none."""
    affordable = [
        name
        for name, agreement in agreements.items()
        if costs_s[name] <= most_s and not np.isnan(agreement.all_points.value)
    ]
    return max(affordable, key=lambda name: agreements[name].all_points.value, default="")
