"""Choose the screening: which short budget ranks points as long trials do.

24 points, spread evenly over the grid's factors, are trained once with the long budget of the reference and
once with each candidate for the screening. The best candidate is the one whose errors agree best with the
reference's by Kendall's tau, among those of about equal cost. Every trial is kept in a study: the same
command continues after Ctrl-C or a kill, and --report shows what there is by now.

The options of the budget are those of the reference; its networks, and its scenes unless a candidate has its
own, are those of the candidates too. The reference takes hours; with --only the rest can be run before.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.parsing import positive_int
from sweeps.queue import job_selection
from sweeps.queue.study_storage import (
    RetryPolicy,
    open_existing_storage,
    quiet_optuna,
    require_folder,
)
from sweeps.screening import report
from sweeps.screening.candidates import (
    CANDIDATES,
    REFERENCE,
    adapt_candidate,
    spread_points,
)
from sweeps.trials.budget import Budget, add_budget_arguments, budget_from_args
from sweeps.trials.search_space import POINTS
from sweeps.workers.grid_study import open_grid_study, run_study
from sweeps.workers.worker_arguments import add_worker_arguments, worker_options
from sweeps.workers.worker_settings import WorkerSettings

_REFERENCE = "reference"


def main(arguments: Sequence[str]) -> None:
    """Run the candidates, then the reference, and report how well each candidate agrees with it."""
    options = _make_parser().parse_args(arguments)
    require_writable(options.out / report.TABLE)
    quiet_optuna()
    policy = RetryPolicy(time_limit_s=options.time_limit)
    reference = budget_from_args(options, REFERENCE)
    # The reference last: it takes by far the longest.
    budgets = {name: adapt_candidate(budget, reference) for name, budget in CANDIDATES.items()}
    budgets[_REFERENCE] = reference
    numbers = spread_points(options.points)
    if options.report:
        open_existing_storage(options.storage)
    else:
        for name in options.only or budgets:
            _run(options, name, budgets[name], numbers, policy)
    trials = report.read_studies(options.storage, {name: _study(name) for name in budgets})
    errors = trials.pop(_REFERENCE)
    lines, figures = report.write_report(options.out, reference=errors, candidates=trials, budgets=budgets)
    print("\n".join(lines))
    if options.json:
        write_json(options.json, figures)


def _run(
    options: argparse.Namespace, name: str, budget: Budget, numbers: Sequence[int], policy: RetryPolicy
) -> None:
    # Not the seed of the screening: its ranking should hold for another seed than its own.
    jobs = (
        job_selection.repeat_points(numbers, seeds=options.reference_seeds)
        if name == _REFERENCE
        else job_selection.select_points(numbers)
    )
    settings = WorkerSettings(
        study=_study(name),
        budget=budget,
        policy=policy,
        **worker_options(options),
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
    add_worker_arguments(parser, storage="runs/sweep/screening.db", time_limit_s=7200.0)
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
    add_budget_arguments(parser, REFERENCE)
    return parser


if __name__ == "__main__":
    run_command(main)
