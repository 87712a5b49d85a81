"""What trials say: error by severity, where a method breaks, coverage, and risk against coverage."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from laesi_tf.benchmarks.stress.nuisances import Nuisance
from laesi_tf.benchmarks.stress.trials import Trial
from laesi_tf.evaluation.photo_scores import bootstrap_interval

COLUMNS = (
    *("nuisance", "step", "severity", "unit", "method", "set", "n", "refused", "silent_errors"),
    *("mre_percent", "mre_low", "mre_high", "median_percent", "bias_percent", "within_2_sd"),
)
"""Columns of stress.csv."""
Row = dict[str, Any]
"""One severity of a nuisance, one method and one set, by COLUMNS."""

BREAKS_AT_PERCENT = (5.0, 25.0)
"""Mean relative errors at which a method counts as broken, slightly and for good."""
SET_ASIDE = (0.0, 0.05, 0.1, 0.2)
"""Shares of the least certain areas that are set aside."""


def summarise_trials(trials: Iterable[Trial], nuisances: Sequence[Nuisance]) -> list[Row]:
    """Return one row for each nuisance, severity, method and set, in the order of the trials."""
    groups: dict[tuple[str, str, str, int], list[Trial]] = defaultdict(list)
    for trial in trials:
        groups[trial.set, trial.nuisance, trial.method, trial.step].append(trial)
    known = {nuisance.name: nuisance for nuisance in nuisances}
    return [_summarise(known[name], group) for (_, name, _, _), group in groups.items()]


def _summarise(nuisance: Nuisance, group: Sequence[Trial]) -> Row:
    first = group[0]
    errors = 100 * np.array([trial.error for trial in group if trial.error is not None])
    low, high = bootstrap_interval(np.abs(errors)) if errors.size else (None, None)
    return {
        "nuisance": nuisance.name,
        "step": first.step,
        "severity": nuisance.label(first.step),
        "unit": nuisance.unit,
        "method": first.method,
        "set": first.set,
        "n": len(group),
        "refused": sum(trial.refusal is not None for trial in group),
        "silent_errors": sum(trial.is_silent_error for trial in group),
        "mre_percent": float(np.abs(errors).mean()) if errors.size else None,
        "mre_low": low,
        "mre_high": high,
        "median_percent": float(np.median(np.abs(errors))) if errors.size else None,
        "bias_percent": float(errors.mean()) if errors.size else None,
        "within_2_sd": measure_coverage(group),
    }


def measure_coverage(trials: Iterable[Trial], deviations: float = 2.0) -> float | None:
    """Return the share of areas within so many stated standard deviations; None where none is stated."""
    within = [
        abs(trial.predicted_cm2 - trial.true_cm2) <= deviations * trial.uncertainty_cm2
        for trial in trials
        if trial.predicted_cm2 is not None and trial.uncertainty_cm2 is not None
    ]
    return float(np.mean(within)) if within else None


def find_breakdowns(rows: Sequence[Row]) -> list[Row]:
    """Return, for each nuisance, method and set, the first severity that breaks it; None if none does.

    A method breaks where its mean relative error passes a limit of BREAKS_AT_PERCENT, or where half of the
    pictures are refused.
    """
    groups: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        groups[row["nuisance"], row["method"], row["set"]].append(row)
    return [
        {
            **{name: steps[0][name] for name in ("nuisance", "unit", "method", "set")},
            **{f"over_{limit:g}_percent": _first(steps, limit) for limit in BREAKS_AT_PERCENT},
            "half_refused": next((row["severity"] for row in steps if row["refused"] >= row["n"] / 2), None),
            "silent_errors": sum(row["silent_errors"] for row in steps),
        }
        for steps in groups.values()
    ]


def _first(steps: Sequence[Row], limit: float) -> str | None:
    return next(
        (r["severity"] for r in steps if r["mre_percent"] is not None and r["mre_percent"] > limit), None
    )


def measure_risk(trials: Iterable[Trial]) -> dict[str, list[float | None]]:
    """Return by method the MRE in percent that remains with each share of SET_ASIDE set aside.

    The least certain areas are those of the largest stated relative uncertainty; methods that state none
    have no entry. A picture without a nuisance belongs to all of them and counts once.
    """
    by_method: dict[str, list[tuple[float, float]]] = defaultdict(list)
    calm: set[tuple[str, str, int]] = set()
    for trial in trials:
        key = trial.set, trial.method, trial.picture
        if not trial.step and key in calm:
            continue
        calm |= set() if trial.step else {key}
        if trial.error is not None and trial.uncertainty_cm2 is not None and trial.predicted_cm2:
            by_method[trial.method].append((trial.uncertainty_cm2 / trial.predicted_cm2, abs(trial.error)))
    return {method: _remaining_errors(pairs) for method, pairs in by_method.items()}


def _remaining_errors(pairs: Sequence[tuple[float, float]]) -> list[float | None]:
    errors = np.array([error for _, error in sorted(pairs)])
    kept = [round(len(errors) * (1 - share)) for share in SET_ASIDE]
    return [100 * float(errors[:count].mean()) if count else None for count in kept]


def index_rows(rows: Sequence[Row]) -> Mapping[tuple[str, str], dict[str, list[Row]]]:
    """Return rows by (nuisance, set), then by method, in order of severity."""
    index: dict[tuple[str, str], dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        index[row["nuisance"], row["set"]][row["method"]].append(row)
    return index
