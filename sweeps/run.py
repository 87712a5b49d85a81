"""Work off the 1,425 points of the grid in one Optuna study, or continue where it was stopped.

Start it again to continue, on as many machines as you like if the storage is PostgreSQL. Every point ends
once as complete; what a point fails with is kept with its trial. With --finalists the best points of a
finished study are tried again at a larger budget, with --spread as many from its best to its worst, which
shows whether the small budget ranks as the larger does. With --sampler tpe the same space is searched
freely.
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int

# isort: split
from optuna.trial import TrialState

from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import DEFAULT_STORAGE, RetryPolicy, StudyStorage, artifact_folder
from sweeps.queue.trial_queue import JOB, REASON, Job, TrialQueue
from sweeps.trials.budget import FINAL, SCREENING
from sweeps.trials.budget_arguments import add_budget_arguments, budget_from_args
from sweeps.trials.search_space import FACTORS
from sweeps.workers import worker_pool
from sweeps.workers.process import run_worker_process
from sweeps.workers.worker_settings import WorkerSettings

FINALISTS, SPREAD = "finalists", "spread"


def main(arguments: Sequence[str]) -> None:
    """Write the jobs down, have workers do them, tell how they ended."""
    options = _make_parser().parse_args(arguments)
    if options.json:
        require_writable(options.json)
    orders = _make_settings(options)
    book = orders.open()
    wanted = [] if orders.trials else _select_jobs(options, book.store)
    book.agree("budget", orders.budget.told())
    total = orders.trials or _enqueue_jobs(book, wanted)
    if not book.store.patiently(book.finished):
        worker_pool.run_worker_pool(
            run_worker_process, (orders,), workers=options.workers, book=book, total=total
        )
    figures = _summarise_study(book)
    print(_format_summary(figures))
    if options.json:
        write_json(options.json, figures)
    if figures["given_up"]:
        raise SystemExit(1)


def _enqueue_jobs(ledger: TrialQueue, wanted: Sequence[Job]) -> int:
    """Write down what is missing in the study and settle what was left open; how many jobs there are."""
    assert isinstance(ledger, GridQueue)
    ledger.store.patiently(lambda: ledger.fill(wanted))
    ledger.store.patiently(ledger.settle)
    return len(ledger.store.patiently(ledger.standings))


def _select_jobs(options: argparse.Namespace, store: StudyStorage) -> list[Job]:
    if not (options.finalists or options.spread):
        return job_selection.select_points(job_selection.parse_point_numbers(options.points))
    screened = GridQueue(store, options.screened, FACTORS).standings()
    if options.finalists:
        return job_selection.select_finalists(screened, count=options.finalists, seeds=options.seeds)
    return job_selection.select_across_ranking(screened, count=options.spread, seeds=options.seeds)


def _summarise_study(book: TrialQueue) -> dict[str, Any]:
    trials, counts = book.store.patiently(book.trials), book.store.patiently(book.counts)
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    best = min(complete, key=lambda trial: trial.values[0], default=None)
    return {
        "study": book.name,
        **{state.name.lower(): count for state, count in counts.items()},
        "given_up": _given_up(book),
        "best_job": best.user_attrs[JOB] if best else None,
        "best_mre": best.values[0] if best else None,
        "best_levels": best.params if best else None,
    }


def _given_up(book: TrialQueue) -> dict[str, list[str]]:
    """The reasons of each job that is tried no more."""
    if not isinstance(book, GridQueue):
        return {}
    standings = book.store.patiently(book.standings)
    over = {name: one for name, one in standings.items() if not (one.complete or one.running or one.waiting)}
    return {name: [trial.user_attrs.get(REASON, "") for trial in one.failed] for name, one in over.items()}


def _format_summary(figures: dict[str, Any]) -> str:
    lines = ["study {study}: {complete} complete, {pruned} pruned, {fail} attempts failed".format(**figures)]
    if figures["best_job"]:
        levels = ", ".join(figures["best_levels"].values())
        lines.append(f"best: {figures['best_job']} with an MRE of {figures['best_mre']:.2f} %: {levels}")
    lines += [f"given up: {name}: {'; '.join(why)}" for name, why in figures["given_up"].items()]
    return "\n".join(lines)


def _make_settings(options: argparse.Namespace) -> WorkerSettings:
    again = (options.finalists and FINALISTS) or (options.spread and SPREAD)
    if again and options.sampler != "grid":
        raise InputError(f"--{again} takes points of the grid: leave --sampler out")
    cores = os.cpu_count() or 1
    study = options.study or again or options.sampler
    beats = options.heartbeat
    return WorkerSettings(
        storage=options.storage,
        study=study,
        budget=budget_from_args(options, FINAL if again else SCREENING),
        # Six beats: tracing a network can keep a worker from one or two.
        rules=RetryPolicy(options.retries, options.time_limit, beats, 6 * beats),
        folder=options.folder or artifact_folder(options.storage),
        threads=max(1, cores // options.workers),
        trials=options.trials if options.sampler == "tpe" else 0,
    )


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("run", __doc__, package="sweeps")
    made.add_argument(
        "--storage", default=DEFAULT_STORAGE, help="a file, or postgresql://USER@HOST:PORT/DATABASE"
    )
    made.add_argument("--study", help="the study's name (default: grid, tpe or finalists)")
    made.add_argument("--folder", type=Path, help="for artifacts and checkpoints (default: beside the file)")
    made.add_argument(
        "--workers", type=positive_int, default=min(4, os.cpu_count() or 1), help="processes here"
    )
    made.add_argument("--sampler", choices=("grid", "tpe"), default="grid", help="all points, or a search")
    made.add_argument("--trials", type=positive_int, default=150, help="trials of a search")
    made.add_argument("--points", default="0-1424", help="numbers of points, as 0-19,380")
    again = made.add_mutually_exclusive_group()
    again.add_argument(
        "--finalists", type=positive_int, help="try this many best, and the paper's optimum, again"
    )
    again.add_argument("--spread", type=positive_int, help="try this many from the best to the worst again")
    made.add_argument("--screened", default="grid", metavar="STUDY", help="the study those come from")
    made.add_argument("--seeds", type=positive_int, default=3, help="seeds of each that is tried again")
    made.add_argument("--retries", type=int, default=3, help="attempts at a point after the first")
    made.add_argument("--time-limit", type=float, default=300.0, metavar="S", help="seconds a trial may take")
    made.add_argument(
        "--heartbeat",
        type=positive_int,
        default=10,
        metavar="S",
        help="seconds between signs of life; six missed and a worker's trial is given to another",
    )
    add_budget_arguments(made)
    return made


if __name__ == "__main__":
    run_command(main)
