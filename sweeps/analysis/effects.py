"""What each factor does to the error: main effects and interactions of pairs, with intervals.

The response is the logarithm of the MRE, so that effects are ratios: a level that takes a tenth off a large
error takes a tenth off a small one. The grid is a full factorial with one trial per point, so the averages
of a level over all others are clean of them, and least squares gives intervals: the model has the main
effects and the interactions of pairs, and what is left over (interactions of three and more, and chance) is
the error. Resampling points instead, as a bootstrap would, breaks the balance that makes the averages
clean. The residuals are not equally wide for all levels, hence the robust covariance (HC3). Intervals are
simultaneous within a factor (Bonferroni), as one looks for the best of its levels.

All trials of a screening share one seed and the same pictures: the intervals say nothing of others.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from laesi_tf.common.errors import InputError
from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import FACTORS

_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Effect:
    """How much the MRE at a level, or a pair of levels, is above what it is elsewhere, in percent."""

    factor: str
    level: str
    change: float
    low: float
    high: float

    @property
    def is_told_apart(self) -> bool:
        """Whether the interval leaves out zero."""
        return self.low > 0 or self.high < 0


@dataclass(frozen=True)
class EffectModel:
    """A fitted model: its effects, and the share of the variance that each term explains, 0..1.

    `by_chance` is the share that a term without any effect is expected to have.
    """

    main: list[Effect]
    pairs: list[Effect]
    shares: dict[str, float]
    by_chance: dict[str, float]
    residual: float


def estimate_effects(rows: Sequence[TrialRecord]) -> EffectModel:
    """Effects over `rows`, one per point of the grid or of a part that is a full factorial itself.

    Raises InputError for other parts: averages over unlike points compare nothing.
    """
    levels = {name: _levels_present(rows, name, every) for name, every in FACTORS.items()}
    levels = {name: found for name, found in levels.items() if len(found) > 1}
    whole = int(np.prod([len(found) for found in levels.values()]))
    if whole != len(rows) or len({row.point for row in rows}) != whole or whole < 2:
        told = " x ".join(str(len(found)) for found in levels.values()) or "1"
        raise InputError(f"{len(rows)} trials are not all {told} combinations of their levels")
    coded = {
        name: _code_deviations([row.point.levels[name] for row in rows], found)
        for name, found in levels.items()
    }
    terms: dict[tuple[str, ...], np.ndarray] = {(name,): columns for name, columns in coded.items()}
    for one, other in itertools.combinations(coded, 2):
        terms[one, other] = _multiply_columns(coded[one], coded[other])
    response = np.log([row.mre for row in rows])
    model = _fit_least_squares(terms, response)
    main = [_estimate_effect(model, (name,), [level], levels) for name in levels for level in levels[name]]
    pairs = [
        _estimate_effect(model, pair, chosen, levels)
        for pair in itertools.combinations(levels, 2)
        for chosen in itertools.product(*(levels[name] for name in pair))
    ]
    total = float(np.sum((response - response.mean()) ** 2))
    shares = {" x ".join(term): model.explained[term] / total for term in terms}
    residual = model.left_over / total
    each = residual / model.freedom
    by_chance = {" x ".join(term): each * columns.shape[1] for term, columns in terms.items()}
    return EffectModel(main, pairs, shares, by_chance, residual)


@dataclass(frozen=True)
class _LeastSquaresFit:
    places: dict[tuple[str, ...], slice]
    coefficients: np.ndarray
    covariance: np.ndarray
    explained: dict[tuple[str, ...], float]
    left_over: float
    freedom: int


def _fit_least_squares(terms: dict[tuple[str, ...], np.ndarray], response: np.ndarray) -> _LeastSquaresFit:
    """Ordinary least squares with an HC3 covariance; terms of a balanced design are orthogonal."""
    design = np.column_stack([np.ones(len(response)), *terms.values()])
    ends = np.cumsum([1, *(columns.shape[1] for columns in terms.values())])
    places = {term: slice(*ends[place : place + 2]) for place, term in enumerate(terms)}
    freedom = len(response) - design.shape[1]
    if freedom < 1:
        raise InputError(f"{len(response)} trials are too few for intervals: three factors must vary")
    inverse = np.linalg.inv(design.T @ design)
    coefficients = inverse @ design.T @ response
    residuals = response - design @ coefficients
    leverage = np.sum(design @ inverse * design, axis=1)
    weights = (residuals / np.maximum(1 - leverage, 1e-9)) ** 2
    covariance = inverse @ (design.T * weights) @ design @ inverse
    explained = {
        term: float(np.sum((design[:, place] @ coefficients[place]) ** 2)) for term, place in places.items()
    }
    return _LeastSquaresFit(
        places, coefficients, covariance, explained, float(residuals @ residuals), freedom
    )


def _estimate_effect(
    model: _LeastSquaresFit, term: tuple[str, ...], chosen: Sequence[str], levels: dict[str, tuple[str, ...]]
) -> Effect:
    """The change at `chosen`, a level of each factor of `term`, against the average over the term."""
    rows = [_code_deviations([level], levels[name]) for name, level in zip(term, chosen, strict=True)]
    contrast = rows[0] if len(rows) == 1 else _multiply_columns(*rows)
    place = model.places[term]
    value = float((contrast @ model.coefficients[place])[0])
    error = float(np.sqrt((contrast @ model.covariance[place, place] @ contrast.T)[0, 0]))
    looked_at = np.prod([len(levels[name]) for name in term])
    reach = error * stats.t.ppf(1 - (1 - _CONFIDENCE) / 2 / looked_at, model.freedom)
    change, low, high = (100 * (np.exp(x) - 1) for x in (value, value - reach, value + reach))
    return Effect(" x ".join(term), " x ".join(chosen), float(change), float(low), float(high))


def _levels_present(rows: Sequence[TrialRecord], factor: str, every: Sequence[str]) -> tuple[str, ...]:
    found = {row.point.levels[factor] for row in rows}
    return tuple(level for level in every if level in found)


def _code_deviations(values: Sequence[str], levels: Sequence[str]) -> np.ndarray:
    """Deviations from the mean, [N, levels - 1]: the last level is minus the sum of the others."""
    codes = np.vstack([np.eye(len(levels) - 1), -np.ones(len(levels) - 1)])
    return codes[[levels.index(value) for value in values]]


def _multiply_columns(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return (one[:, :, None] * other[:, None, :]).reshape(len(one), -1)
