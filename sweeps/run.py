"""Run the 1,425 points of the grid as one Optuna study, or continue where it was stopped.

Start the same command again to continue, on any number of machines if the storage is PostgreSQL. Each point
completes exactly once, even if a worker, a trial or the database fails; failures are stored with their
reason. With --finalists the best points of a finished study are repeated at a larger budget, with --spread
points from its best to its worst, which shows whether both budgets rank alike. With --sampler tpe the same
space is searched by TPE with pruning.
"""

import argparse
from collections.abc import Sequence
from typing import Any

from optuna.trial import TrialState

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int
from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import (
    DEFAULT_STORAGE,
    MISSED_HEARTBEATS,
    RetryPolicy,
    open_existing_storage,
    quiet_optuna,
    require_folder,
)
from sweeps.queue.tpe_queue import TpeQueue
from sweeps.queue.trial_queue import JOB, Job, TrialQueue
from sweeps.trials.budget import FINAL, SCREENING, add_budget_arguments, budget_from_args
from sweeps.trials.search_space import FACTORS, POINTS, Point
from sweeps.workers.grid_study import open_grid_study, run_study
from sweeps.workers.worker_arguments import add_worker_arguments, worker_options
from sweeps.workers.worker_settings import WorkerSettings

_ALL_POINTS = f"0-{len(POINTS) - 1}"
_DEFAULT_TRIALS = 150


def main(arguments: Sequence[str]) -> None:
    """Queue the jobs, let workers run them, print how they ended."""
    options = _make_parser().parse_args(arguments)
    _check_combination(options)
    quiet_optuna()
    settings = _make_settings(options)
    require_folder(settings.folder)
    queue: TrialQueue
    if settings.trials:
        queue, points = _open_search(settings), POINTS
    else:
        jobs = _select_jobs(options)
        queue, points = open_grid_study(settings, jobs), tuple(Point(**job.levels) for job in jobs)
    run_study(settings, queue, points, workers=options.workers)
    summary = _summarise_study(queue)
    print(_format_summary(summary))
    if options.json:
        write_json(options.json, summary)
    if summary["given_up"]:
        raise SystemExit(1)


def _open_search(settings: WorkerSettings) -> TpeQueue:
    attributes = settings.budget.to_attributes()
    queue = settings.open_search()
    queue.check_study_setting("budget", attributes)
    return queue


def _select_jobs(options: argparse.Namespace) -> list[Job]:
    if not (options.finalists or options.spread):
        return job_selection.select_points(job_selection.parse_point_numbers(options.points or _ALL_POINTS))
    storage = open_existing_storage(options.storage)
    storage.require_study(options.screened)
    screened = GridQueue(storage, options.screened, FACTORS).job_histories()
    if options.finalists:
        return job_selection.select_finalists(screened, count=options.finalists, seeds=options.seeds)
    return job_selection.select_across_ranking(screened, count=options.spread, seeds=options.seeds)


def _summarise_study(queue: TrialQueue) -> dict[str, Any]:
    retry = queue.storage.retry_while_offline
    trials, counts = retry(queue.get_trials), retry(queue.count_by_state)
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    best = min(complete, key=lambda trial: trial.values[0], default=None)
    return {
        "study": queue.name,
        **{state.name.lower(): count for state, count in counts.items()},
        "given_up": retry(queue.list_given_up),
        "best_job": best.user_attrs[JOB] if best else None,
        "best_mre": best.values[0] if best else None,
        "best_levels": best.params if best else None,
    }


def _format_summary(summary: dict[str, Any]) -> str:
    lines = ["study {study}: {complete} complete, {pruned} pruned, {fail} attempts failed".format(**summary)]
    if summary["best_job"]:
        levels = ", ".join(summary["best_levels"].values())
        lines.append(f"best: {summary['best_job']} with an MRE of {summary['best_mre']:.2f} %: {levels}")
    lines += [f"given up: {name}: {'; '.join(reasons)}" for name, reasons in summary["given_up"].items()]
    return "\n".join(lines)


def _name_repeat_study(options: argparse.Namespace) -> str:
    """Return the default study of the points that are repeated; empty for none."""
    return ("finalists" if options.finalists else "") or ("spread" if options.spread else "")


def _check_combination(options: argparse.Namespace) -> None:
    """Raise InputError for options that have no effect together."""
    repeated = _name_repeat_study(options)
    if repeated and options.sampler != "grid":
        raise InputError(f"--{repeated} repeats points of the grid; leave out --sampler")
    if options.trials and options.sampler != "tpe":
        raise InputError(
            "--trials is the length of a search; add --sampler tpe, or name --points of the grid"
        )
    if options.points and (repeated or options.sampler == "tpe"):
        raise InputError("--points selects points of the grid; leave out --finalists, --spread and --sampler")


def _make_settings(options: argparse.Namespace) -> WorkerSettings:
    repeated = _name_repeat_study(options)
    return WorkerSettings(
        study=options.study or repeated or options.sampler,
        budget=budget_from_args(options, FINAL if repeated else SCREENING),
        policy=RetryPolicy(
            options.retries, options.time_limit, options.heartbeat, MISSED_HEARTBEATS * options.heartbeat
        ),
        **worker_options(options),
        trials=(options.trials or _DEFAULT_TRIALS) if options.sampler == "tpe" else 0,
    )


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("run", __doc__, package="sweeps")
    add_worker_arguments(parser, storage=DEFAULT_STORAGE, time_limit_s=300.0)
    parser.add_argument("--study", help="the study's name (default: grid, tpe, finalists or spread)")
    parser.add_argument("--sampler", choices=("grid", "tpe"), default="grid", help="all points, or a search")
    parser.add_argument(
        "--trials", type=positive_int, help=f"trials of --sampler tpe (default: {_DEFAULT_TRIALS})"
    )
    parser.add_argument("--points", help=f"numbers of points, such as 0-19,380 (default: {_ALL_POINTS})")
    repeated = parser.add_mutually_exclusive_group()
    repeated.add_argument(
        "--finalists", type=positive_int, help="repeat this many best points, and the paper's optimum"
    )
    repeated.add_argument(
        "--spread", type=positive_int, help="repeat this many points, from the best to the worst"
    )
    parser.add_argument(
        "--screened", default="grid", metavar="STUDY", help="study from which points are repeated"
    )
    parser.add_argument("--seeds", type=positive_int, default=3, help="seeds of each repeated point")
    parser.add_argument("--retries", type=int, default=3, help="attempts at a point after the first")
    parser.add_argument(
        "--heartbeat",
        type=positive_int,
        default=10,
        metavar="S",
        help=f"seconds between heartbeats; after {MISSED_HEARTBEATS} missed another worker gets the trial",
    )
    add_budget_arguments(parser, SCREENING, FINAL)
    return parser


if __name__ == "__main__":
    run_command(main)
