"""Choose the screening: which short budget ranks points as long trials do.

24 points, spread evenly over the grid's factors, are trained once with the long budget of the reference and
once with each candidate for the screening. The best candidate is the one whose errors agree best with the
reference's by Kendall's tau, among those of about equal cost. Every trial is kept in a study: the same
command continues after Ctrl-C or a kill, and --report shows what there is by now.

The options of the budget are those of the reference; its networks, and its scenes unless a candidate has its
own, are those of the candidates too. The reference takes hours; with --only the rest can be run before.
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.parsing import positive_float, positive_int
from sweeps.queue import job_selection
from sweeps.queue.study_storage import (
    LOCATION_HELP,
    RetryPolicy,
    artifact_folder,
    open_existing_storage,
    quiet_optuna,
    require_folder,
)
from sweeps.queue.trial_queue import Job
from sweeps.screening import report
from sweeps.screening.candidates import (
    CANDIDATES,
    REFERENCE,
    REFERENCE_SEED,
    adapt_candidate,
    spread_points,
)
from sweeps.trials.budget import Budget, add_budget_arguments, budget_from_args
from sweeps.trials.search_space import POINTS
from sweeps.workers.grid_study import open_grid_study, run_study
from sweeps.workers.worker_settings import WorkerSettings

_REFERENCE = "reference"


def main(arguments: Sequence[str]) -> None:
    """Run the candidates, then the reference, and report how well each candidate agrees with it."""
    options = _make_parser().parse_args(arguments)
    require_writable(options.out / report.TABLE)
    quiet_optuna()
    reference = budget_from_args(options, REFERENCE)
    # The reference last: it takes by far the longest.
    budgets = {name: adapt_candidate(budget, reference) for name, budget in CANDIDATES.items()}
    budgets[_REFERENCE] = reference
    numbers = spread_points(options.points)
    if options.report:
        open_existing_storage(options.storage)
    else:
        for name in options.only or budgets:
            _run(options, name, budgets[name], numbers)
    trials = report.read_studies(options.storage, {name: _study(name) for name in budgets})
    errors = trials.pop(_REFERENCE)
    lines, figures = report.write_report(options.out, reference=errors, candidates=trials, budgets=budgets)
    print("\n".join(lines))
    if options.json:
        write_json(options.json, figures)


def _run(options: argparse.Namespace, name: str, budget: Budget, numbers: Sequence[int]) -> None:
    jobs = job_selection.select_points(numbers)
    if name == _REFERENCE:
        jobs = [
            Job(f"{number:04d}/{seed}", POINTS[number].levels, seed)
            for seed in range(REFERENCE_SEED, REFERENCE_SEED + options.reference_seeds)
            for number in numbers
        ]
    settings = WorkerSettings(
        storage=options.storage,
        study=_study(name),
        budget=budget,
        policy=RetryPolicy(time_limit_s=options.time_limit),
        folder=options.folder or artifact_folder(options.storage),
        threads=options.threads or max(1, (os.cpu_count() or 1) // options.workers),
    )
    require_folder(settings.folder)
    queue = open_grid_study(settings, jobs)
    print(f"{name}: {len(jobs)} trials", flush=True)
    run_study(settings, queue, [POINTS[number] for number in numbers], workers=options.workers)
    for job, reasons in queue.list_given_up().items():
        print(f"given up, and left out: {name} {job}: {'; '.join(reasons)}")


def _study(name: str) -> str:
    return f"screening-{name}"


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("screening", __doc__, package="sweeps")
    parser.add_argument("--storage", default="runs/sweep/screening.db", help=LOCATION_HELP)
    parser.add_argument(
        "--folder", type=Path, help="folder of artifacts (default: that of the storage's file)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("sweeps/results"), metavar="FOLDER", help="folder of the tables"
    )
    parser.add_argument(
        "--points", type=positive_int, default=24, metavar="N", help="points of the reference"
    )
    parser.add_argument(
        "--reference-seeds",
        type=positive_int,
        default=1,
        metavar="N",
        help="seeds of the reference; from two on, how well it agrees with itself is shown too",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[*CANDIDATES, _REFERENCE],
        metavar="NAME",
        help=f"run only these: {', '.join([*CANDIDATES, _REFERENCE])}",
    )
    parser.add_argument("--report", action="store_true", help="run nothing; report what there is")
    parser.add_argument(
        "--workers", type=positive_int, default=min(4, os.cpu_count() or 1), help="processes on this machine"
    )
    parser.add_argument(
        "--threads", type=positive_int, help="threads of each worker (default: its share of the cores)"
    )
    parser.add_argument(
        "--time-limit",
        type=positive_float,
        default=7200.0,
        metavar="S",
        help="seconds that a trial may take",
    )
    add_budget_arguments(parser, REFERENCE)
    return parser


if __name__ == "__main__":
    run_command(main)
