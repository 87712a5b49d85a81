"""Test which learning rate suits each optimizer: short trials at rates half a decade apart.

The MRE of a trial is divided by the lowest that the same optimizer reaches from the same starting point with
the same seed, as starting points differ by more than rates. The rate of an optimizer is the lowest one at
which the median of these ratios is within a tenth of the best: short trials favour high rates, long ones do
not. With a rate of its own for each, the grid compares optimizers instead of rates.

Smith's range test (2017), one run with a rising rate, is shorter, but where to stop on its curve is a rule of
thumb for each optimizer; whole trials measure what the grid compares. The trials are kept in a study, which
the same command continues.

The printed rates are committed by hand as LEARNING_RATES in sweeps/trials/search_space.py.
"""

import argparse
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from optuna.trial import FrozenTrial, TrialState

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_csv, write_json
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.parsing import positive_int
from laesi_tf.reporting.markdown import format_table
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import LOCATION_HELP, RetryPolicy, StudyStorage, quiet_optuna
from sweeps.queue.trial_queue import SEED, ClaimedTrial, Job
from sweeps.trials.budget import SCREENING, add_budget_arguments, budget_from_args
from sweeps.trials.search_space import FACTORS, STARTS, Point
from sweeps.workers.watchdog import TrialWatchdog
from sweeps.workers.worker import TrialResult, run_trials

if TYPE_CHECKING:
    from sweeps.trials.trial_runner import TrialRunner

_ADAPTIVE = ("0.0001", "0.0003", "0.001", "0.003", "0.01", "0.03")
_RATES = dict.fromkeys(FACTORS["optimizer"], _ADAPTIVE) | {
    "sgd": ("0.001", "0.003", "0.01", "0.03", "0.1", "0.3", "1")
}
"""Text, as they are levels of a study. Steps of adaptive optimizers do not depend on the gradient's size."""
_FACTORS = {
    "start": STARTS,
    "optimizer": FACTORS["optimizer"],
    "rate": tuple(sorted({rate for rates in _RATES.values() for rate in rates}, key=float)),
}
_DIVERGED_MRE = 1e6
"""MRE of a trial that diverged, in percent: a result of its rate, and worse than all that did not."""
_TOLERANCE = 1.1
"""Ratios up to this factor above the best count as equal."""
_HEADER = ("optimizer", "rate", "start", "seed", "mre")


@dataclass(frozen=True)
class RateTrial:
    """A trial of the test; its MRE is in percent."""

    optimizer: str
    rate: float
    start: str
    seed: int
    mre: float


def main(arguments: Sequence[str]) -> None:
    """Run the trials that are missing, print how much worse each rate is, and the best ones."""
    options = _make_parser().parse_args(arguments)
    if options.out:
        require_writable(options.out)
    budget = budget_from_args(options, SCREENING)
    attributes = budget.to_attributes()
    # It is what the test is to find.
    del attributes["learning_rates"]
    quiet_optuna()
    policy = RetryPolicy(retries=1)
    queue = GridQueue(StudyStorage(options.storage, policy), options.study, _FACTORS, group=_group)
    queue.check_study_setting("budget", attributes)
    queue.enqueue(_make_jobs(options.seeds))
    if not queue.is_finished():
        load_tensorflow(threads=options.threads)
        from sweeps.trials.training_data import TrainingData
        from sweeps.trials.trial_runner import TrialRunner, check_weights

        check_weights(budget, (_point(job) for job in _make_jobs(1)))
        runner = TrialRunner(budget, TrainingData(budget, threads=options.threads))
        run_trials(queue, lambda claim, watchdog: _try_rate(runner, claim, watchdog))
    trials = _read_trials(queue.get_trials())
    best = best_rates(trials)
    print("\n".join([*_format_ratios(trials), "", *(f"{name}: {rate:g}" for name, rate in best.items())]))
    if options.out:
        write_csv(options.out, _HEADER, [[*vars(trial).values()] for trial in trials])
    if options.json:
        write_json(options.json, {"best": best, "budget": attributes, **describe_hardware()})


def median_ratios(trials: Iterable[RateTrial]) -> dict[str, dict[float, float]]:
    """Return the median ratio of the MRE to the lowest of the same start and seed, by optimizer and rate.

    Starts and seeds that lack one of an optimizer's rates, as in an unfinished study, are left out.
    """
    errors: dict[tuple[str, str, int], dict[float, float]] = {}
    for trial in trials:
        errors.setdefault((trial.optimizer, trial.start, trial.seed), {})[trial.rate] = trial.mre
    medians = {}
    for name, texts in _RATES.items():
        rates = [float(text) for text in texts]
        complete = [found for key, found in errors.items() if key[0] == name and found.keys() == {*rates}]
        if complete:
            medians[name] = {
                rate: float(np.median([found[rate] / min(found.values()) for found in complete]))
                for rate in rates
            }
    return medians


def best_rates(trials: Iterable[RateTrial]) -> dict[str, float]:
    """Return the lowest rate of each optimizer whose median ratio is within a tenth of the best."""
    return {
        name: next(rate for rate, ratio in ratios.items() if ratio <= _TOLERANCE * min(ratios.values()))
        for name, ratios in median_ratios(trials).items()
    }


def _make_jobs(seeds: int) -> list[Job]:
    """Return a job for each rate, starting point and seed; names sort by seed, so that tables fill evenly."""
    jobs = itertools.product(range(seeds), FACTORS["optimizer"], STARTS)
    levels = [
        (seed, {"optimizer": optimizer, "start": start, "rate": rate})
        for seed, optimizer, start in jobs
        for rate in _RATES[optimizer]
    ]
    return [Job(" ".join([str(seed), *level.values()]), level, seed) for seed, level in levels]


def _point(job: Job) -> Point:
    """Return a point to try a rate with: the paper's schedule, whose first half is at the highest rate."""
    return Point(job.levels["start"], job.levels["optimizer"], "piecewise", "none")


def _group(job: Job) -> tuple[int, str, bool]:
    return job.seed, job.levels["optimizer"], job.levels["start"] == "small_imagenet"


def _try_rate(runner: "TrialRunner", claim: ClaimedTrial, watchdog: TrialWatchdog) -> TrialResult:
    from laesi_tf.training.trainer import TrainingDiverged

    point, seed = _point(claim.job), claim.job.seed
    runner.prepare(point, seed)
    watchdog.start_clock()
    try:
        outcome = runner.run(
            point,
            seed,
            learning_rate=float(claim.job.levels["rate"]),
            check_timeout=watchdog.check_timeout,
        )
    except TrainingDiverged:
        return TrialResult([_DIVERGED_MRE, 0.0], {})
    return TrialResult([min(outcome.mre, _DIVERGED_MRE), outcome.steps_s], {})


def _read_trials(trials: Iterable[FrozenTrial]) -> list[RateTrial]:
    return [
        RateTrial(
            optimizer=trial.params["optimizer"],
            rate=float(trial.params["rate"]),
            start=trial.params["start"],
            seed=trial.user_attrs[SEED],
            mre=trial.values[0],
        )
        for trial in trials
        if trial.state is TrialState.COMPLETE
    ]


def _format_ratios(trials: Sequence[RateTrial]) -> list[str]:
    medians = median_ratios(trials)
    rates = sorted({rate for ratios in medians.values() for rate in ratios})
    rows: list[list[Any]] = [
        [name, *(f"{ratios[rate]:.2f}" if rate in ratios else "" for rate in rates)]
        for name, ratios in medians.items()
    ]
    runs = len({(trial.start, trial.seed) for trial in trials})
    return [
        f"MRE over the lowest of the optimizer, median of {runs} starting points and seeds, by highest rate:",
        "",
        *format_table(["optimizer", *(f"{rate:g}" for rate in rates)], rows),
    ]


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("learning_rates", __doc__, package="sweeps")
    parser.add_argument("--storage", default="runs/sweep/learning_rates.db", help=LOCATION_HELP)
    parser.add_argument("--study", default="learning_rates", help="the study's name")
    parser.add_argument("--seeds", type=positive_int, default=2, help="seeds of each rate and starting point")
    parser.add_argument("--threads", type=positive_int, default=1, help="threads of this process")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the trials as CSV to FILE")
    add_budget_arguments(parser, SCREENING)
    return parser


if __name__ == "__main__":
    run_command(main)
