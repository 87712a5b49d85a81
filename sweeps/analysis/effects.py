"""The effect of each factor on the error: main effects and two-factor interactions, with intervals.

The response is the logarithm of the MRE, so that effects are ratios: a level that takes a tenth off a large
error takes a tenth off a small one. The grid is a full factorial with one trial per point, so the averages of
a level over all others do not depend on those others, and least squares gives intervals: the model has the
main effects and the two-factor interactions, and the residual (interactions of three and more factors, and
chance) is the error. Resampling points instead, as a bootstrap would, breaks the balance of the design. The
residuals do not have the same variance for all levels, hence the robust covariance (HC3). Intervals are
simultaneous within a factor (Bonferroni), as a reader looks for the best of its levels.

All trials of a screening share one seed and the same images: the intervals do not cover other seeds and
images.
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
Levels = dict[str, tuple[str, ...]]
"""The levels of each factor that occur, for the factors that vary."""


@dataclass(frozen=True)
class Effect:
    """The change of the MRE in percent at a level, or a pair of levels, against the average."""

    factor: str
    level: str
    change: float
    low: float
    high: float

    @property
    def is_significant(self) -> bool:
        """Whether the interval excludes zero."""
        return self.low > 0 or self.high < 0


@dataclass(frozen=True)
class EffectModel:
    """A fitted model: its effects, and the share of the variance that each term explains, 0..1.

    `by_chance` is the share that is expected of a term without any effect.
    """

    main: list[Effect]
    pairs: list[Effect]
    shares: dict[str, float]
    by_chance: dict[str, float]
    residual: float


def select_balanced_part(records: Sequence[TrialRecord]) -> list[TrialRecord]:
    """Return the trials of a full factorial within `records`: all of them if the grid is complete.

    The level that misses the largest share of its combinations is removed until none is missing.
    """
    part = list({record.point: record for record in records}.values())
    while True:
        levels = {name: _levels_present(part, name) for name in FACTORS}
        expected = int(np.prod([len(present) for present in levels.values()]))
        if expected == len(part):
            return part
        coverage = {
            (name, level): sum(record.point.levels[name] == level for record in part)
            * len(present)
            / expected
            for name, present in levels.items()
            for level in present
            if len(present) > 1
        }
        factor, worst = min(coverage, key=lambda key: coverage[key])
        part = [record for record in part if record.point.levels[factor] != worst]


def has_enough_factors(records: Sequence[TrialRecord]) -> bool:
    """Return whether at least three factors vary, so that two-factor interactions leave a residual."""
    return len(_varying_levels(records)) >= 3


def estimate_effects(records: Sequence[TrialRecord]) -> EffectModel:
    """Estimate the effects over `records`, one per point of a full factorial in which three factors vary.

    Raises InputError for other records: averages over different combinations do not compare.
    """
    levels = _varying_levels(records)
    expected = int(np.prod([len(present) for present in levels.values()]))
    if expected != len(records) or len({record.point for record in records}) != expected or expected < 2:
        sizes = " x ".join(str(len(present)) for present in levels.values()) or "1"
        raise InputError(f"{len(records)} trials are not all {sizes} combinations of their levels")
    codes = {
        name: _code_deviations([record.point.levels[name] for record in records], present)
        for name, present in levels.items()
    }
    terms: dict[tuple[str, ...], np.ndarray] = {(name,): columns for name, columns in codes.items()}
    for one, other in itertools.combinations(codes, 2):
        terms[one, other] = _multiply_columns(codes[one], codes[other])
    response = np.log([record.mre for record in records])
    fit = _fit_least_squares(terms, response)
    main = [_estimate_effect(fit, (name,), [level], levels) for name in levels for level in levels[name]]
    pairs = [
        _estimate_effect(fit, pair, chosen, levels)
        for pair in itertools.combinations(levels, 2)
        for chosen in itertools.product(*(levels[name] for name in pair))
    ]
    total = float(np.sum((response - response.mean()) ** 2))
    residual = fit.residual / total
    per_column = residual / fit.degrees_of_freedom
    return EffectModel(
        main,
        pairs,
        shares={" x ".join(term): fit.explained[term] / total for term in terms},
        by_chance={" x ".join(term): per_column * columns.shape[1] for term, columns in terms.items()},
        residual=residual,
    )


@dataclass(frozen=True)
class _LeastSquaresFit:
    columns: dict[tuple[str, ...], slice]
    coefficients: np.ndarray
    covariance: np.ndarray
    explained: dict[tuple[str, ...], float]
    residual: float
    degrees_of_freedom: int


def _fit_least_squares(terms: dict[tuple[str, ...], np.ndarray], response: np.ndarray) -> _LeastSquaresFit:
    """Fit ordinary least squares with an HC3 covariance; terms of a balanced design are orthogonal."""
    design = np.column_stack([np.ones(len(response)), *terms.values()])
    ends = np.cumsum([1, *(columns.shape[1] for columns in terms.values())])
    columns = {term: slice(*ends[index : index + 2]) for index, term in enumerate(terms)}
    degrees_of_freedom = len(response) - design.shape[1]
    if degrees_of_freedom < 1:
        raise InputError(f"{len(response)} trials are too few for intervals: three factors must vary")
    inverse = np.linalg.inv(design.T @ design)
    coefficients = inverse @ design.T @ response
    residuals = response - design @ coefficients
    leverage = np.sum(design @ inverse * design, axis=1)
    weights = (residuals / np.maximum(1 - leverage, 1e-9)) ** 2
    covariance = inverse @ (design.T * weights) @ design @ inverse
    explained = {
        term: float(np.sum((design[:, place] @ coefficients[place]) ** 2)) for term, place in columns.items()
    }
    return _LeastSquaresFit(
        columns, coefficients, covariance, explained, float(residuals @ residuals), degrees_of_freedom
    )


def _estimate_effect(
    fit: _LeastSquaresFit, term: tuple[str, ...], chosen: Sequence[str], levels: Levels
) -> Effect:
    """Return the change at `chosen`, a level of each factor of `term`, against the average over the term."""
    codes = [_code_deviations([level], levels[name]) for name, level in zip(term, chosen, strict=True)]
    contrast = codes[0] if len(codes) == 1 else _multiply_columns(*codes)
    columns = fit.columns[term]
    value = float((contrast @ fit.coefficients[columns])[0])
    error = float(np.sqrt((contrast @ fit.covariance[columns, columns] @ contrast.T)[0, 0]))
    comparisons = np.prod([len(levels[name]) for name in term])
    margin = error * stats.t.ppf(1 - (1 - _CONFIDENCE) / 2 / comparisons, fit.degrees_of_freedom)
    change, low, high = (100 * (np.exp(x) - 1) for x in (value, value - margin, value + margin))
    return Effect(" x ".join(term), " x ".join(chosen), float(change), float(low), float(high))


def _varying_levels(records: Sequence[TrialRecord]) -> Levels:
    levels = {name: _levels_present(records, name) for name in FACTORS}
    return {name: present for name, present in levels.items() if len(present) > 1}


def _levels_present(records: Sequence[TrialRecord], factor: str) -> tuple[str, ...]:
    found = {record.point.levels[factor] for record in records}
    return tuple(level for level in FACTORS[factor] if level in found)


def _code_deviations(values: Sequence[str], levels: Sequence[str]) -> np.ndarray:
    """Return deviation codes [N, levels - 1]: the last level is minus the sum of the others."""
    codes = np.vstack([np.eye(len(levels) - 1), -np.ones(len(levels) - 1)])
    return codes[[levels.index(value) for value in values]]


def _multiply_columns(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    products: np.ndarray = one[:, :, None] * other[:, None, :]
    return products.reshape(len(one), -1)
