"""Read the studies of the reference and of the candidates, and report which candidate ranks as it does."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.trial import TrialState

from laesi_tf.common.atomic_files import write_csv, write_json
from laesi_tf.common.hardware import describe_hardware, format_hardware
from laesi_tf.reporting.markdown import format_table
from sweeps.queue.job_selection import parse_job_name
from sweeps.queue.study_storage import open_existing_storage
from sweeps.queue.trial_queue import JOB
from sweeps.screening.agreement import (
    Agreement,
    choose_best,
    kendall_tau,
    measure_agreement,
    pair_errors,
    rank_shifts,
    share_of_ordered_pairs,
)
from sweeps.screening.candidates import BEFORE, CANDIDATES, MOST_COST
from sweeps.trials.point_errors import geometric_means
from sweeps.trials.search_space import POINTS

TABLE, POINTS_TABLE, FIGURES = "candidates.csv", "candidate_points.csv", "candidates.json"
_AIMS = (0.6, 0.3)
"""Kendall's tau that a screening should reach over all points, and among their better half."""
_HEADER = (
    "candidate",
    "scenes",
    "size",
    "batch_size",
    "steps",
    "pictures",
    "points",
    "below_guess",
    "cost_s",
)
_TAUS = ("tau", "tau_low", "tau_high", "half_tau", "half_low", "half_high")


@dataclass
class StudyResult:
    """The complete trials of a study.

    `errors` are (number, seed, MRE in percent), `cost_s` the median CPU time of a trial's steps and
    evaluation in seconds, `guess` the MRE of a constant guess in percent.
    """

    errors: list[tuple[int, int, float]] = field(default_factory=list)
    cost_s: float = np.nan
    guess: float = np.nan

    @property
    def by_point(self) -> dict[int, float]:
        """The geometric mean of the MRE over seeds, in percent, by the point's number."""
        return geometric_means([(number, mre) for number, _, mre in self.errors])

    @property
    def below_guess(self) -> int:
        """The points that are better than a constant guess."""
        return sum(mre < self.guess for mre in self.by_point.values())


def read_studies(location: str, studies: Mapping[str, str]) -> dict[str, StudyResult]:
    """Return the complete trials of `studies`, by their key; empty for a study that does not exist."""
    storage = open_existing_storage(location)
    names = storage.study_names()
    return {
        key: _read_study(optuna.load_study(study_name=name, storage=storage.rdb))
        if name in names
        else StudyResult()
        for key, name in studies.items()
    }


def _read_study(study: optuna.Study) -> StudyResult:
    trials = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    costs = [trial.user_attrs["steps_cpu_s"] + trial.user_attrs["judging_s"] for trial in trials]
    errors = sorted((*parse_job_name(trial.user_attrs[JOB]), trial.values[0]) for trial in trials)
    return StudyResult(
        errors,
        float(np.median(costs)) if costs else np.nan,
        study.user_attrs.get("guess_mre") or np.nan,
    )


def write_report(
    out: Path, *, reference: StudyResult, candidates: Mapping[str, StudyResult], budgets: Mapping[str, Any]
) -> tuple[list[str], dict[str, Any]]:
    """Write the tables and the figures to the folder `out`; return the page's lines and the figures."""
    hardware = describe_hardware()
    found = {name: result for name, result in candidates.items() if result.errors}
    agreements = {name: measure_agreement(reference.by_point, found[name].by_point) for name in found}
    costs = {name: result.cost_s for name, result in found.items()}
    best = choose_best(agreements, costs, MOST_COST * costs.get(BEFORE, np.inf))
    rows = [
        [name, *_describe(budgets[name], found[name]), *_flatten(agreements[name])]
        for name in CANDIDATES
        if name in found
    ]
    write_csv(out / TABLE, [*_HEADER, *_TAUS], [[_round(cell) for cell in row] for row in rows])
    _write_points(out / POINTS_TABLE, reference, found)
    figures = {
        "reference": {"errors": reference.by_point, "cost_s": reference.cost_s, "guess_mre": reference.guess},
        "repeatability": _repeatability(reference),
        "candidates": {
            name: {
                "cost_s": costs[name],
                "guess_mre": found[name].guess,
                "errors": found[name].by_point,
                **dataclasses.asdict(agreements[name]),
            }
            for name in found
        },
        "best": best,
        "budgets": {name: budget.to_attributes() for name, budget in budgets.items()},
        **hardware,
    }
    write_json(out / FIGURES, figures)
    lines = _format_table(found, agreements) + _describe_reference(reference)
    if best:
        lines += _describe_best(best, agreements[best], reference, found[best])
    return [*lines, format_hardware(hardware)], figures


def _describe(budget: Any, result: StudyResult) -> list[Any]:
    scenes = Path(budget.ranges).name
    sizes = [budget.size, budget.batch_size, budget.steps, budget.pictures]
    return [scenes, *sizes, len(result.by_point), result.below_guess, result.cost_s]


def _flatten(agreement: Agreement) -> list[float]:
    taus = (agreement.all_points, agreement.better_half)
    return [value for tau in taus for value in (tau.value, tau.low, tau.high)]


def _write_points(path: Path, reference: StudyResult, found: Mapping[str, StudyResult]) -> None:
    columns = {"reference": reference.by_point} | {name: result.by_point for name, result in found.items()}
    numbers = sorted({number for errors in columns.values() for number in errors})
    rows = [
        [number, *POINTS[number].levels.values(), POINTS[number].learning_rate]
        + [_round(errors.get(number, "")) for errors in columns.values()]
        for number in numbers
    ]
    write_csv(path, ["number", *POINTS[0].levels, "learning_rate", *columns], rows)


def _repeatability(reference: StudyResult) -> list[dict[str, Any]]:
    """Return Kendall's tau between the first seed of the reference and each other one."""
    by_seed: dict[int, dict[int, float]] = {}
    for number, seed, mre in reference.errors:
        by_seed.setdefault(seed, {})[number] = mre
    first, *others = sorted(by_seed) or [0]
    return [
        {
            "seeds": [first, other],
            **dataclasses.asdict(kendall_tau(pair_errors(by_seed[first], by_seed[other]))),
        }
        for other in others
    ]


def _format_table(found: Mapping[str, StudyResult], agreements: Mapping[str, Agreement]) -> list[str]:
    rows = [
        [
            name,
            f"{found[name].cost_s:.1f}",
            f"{found[name].below_guess} of {len(found[name].by_point)}",
            agreements[name].all_points,
            agreements[name].better_half,
        ]
        for name in CANDIDATES
        if name in found
    ]
    header = ["candidate", "CPU s a trial", "below a constant guess", "tau, all points", "tau, better half"]
    return [*format_table(header, rows), ""]


def _describe_reference(reference: StudyResult) -> list[str]:
    errors = reference.by_point
    if not errors:
        return ["The reference has no complete trial yet: no agreement can be measured.", ""]
    lines = [
        f"Reference: {len(errors)} points, MRE from {min(errors.values()):.1f} to "
        f"{max(errors.values()):.1f} %; {reference.below_guess} are below a constant guess, "
        f"{reference.guess:.1f} %."
    ]
    for repeat in _repeatability(reference):
        lines.append(
            "Seeds {seeds[0]} and {seeds[1]} of the reference agree with a tau of {value:.2f} "
            "[{low:.2f}, {high:.2f}]: no screening can be expected to exceed that.".format(**repeat)
        )
    return [*lines, ""]


def _describe_best(name: str, agreement: Agreement, reference: StudyResult, result: StudyResult) -> list[str]:
    verdicts = [
        f"{tau.value:.2f} {where} ({'reaches' if tau.value >= aim else 'misses'} the aim of {aim:g})"
        for tau, aim, where in zip(
            (agreement.all_points, agreement.better_half),
            _AIMS,
            (f"over {agreement.all_points.points} points", "among the better half"),
            strict=True,
        )
    ]
    ordered = [
        f"{gap}: {100 * share:.0f} % of {pairs}"
        for gap, pairs, share in share_of_ordered_pairs(reference.by_point, result.by_point)
    ]
    shifts = [
        f"{level} {shift:+.1f}"
        for _, level, shift, error in rank_shifts(reference.by_point, result.by_point)
        if abs(shift) > 2 * error
    ]
    return [
        f"Best of those that cost at most {MOST_COST:g} times as much as {BEFORE}: {name}, "
        f"tau {'; '.join(verdicts)}.",
        f"Pairs of points in the right order, by their difference in the reference: {', '.join(ordered)}.",
        "Levels that it ranks worse (+) or better (-) than the reference by more than two standard errors, "
        f"in ranks: {', '.join(shifts) or 'none'}.",
    ]


def _round(value: Any) -> Any:
    return round(value, 4) if isinstance(value, float) else value
