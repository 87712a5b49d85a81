"""Test a PostgreSQL server with many workers: simulated trials, a share of the workers killed at random.

The workers, their queue and their points are those of `sweeps.run`; the trials wait instead of training.
Killed workers (SIGKILL) are replaced. The command then counts in the database how often each point is
complete, prints points per second, and deletes its study. It exits with status 1 if a point is missing or
complete twice.
"""

import argparse
import multiprocessing
import random
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy
from optuna.trial import FrozenTrial, TrialState

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.parsing import non_negative_int, positive_float, positive_int
from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import MISSED_HEARTBEATS, RetryPolicy, StudyStorage, quiet_optuna
from sweeps.queue.trial_queue import JOB, REASON
from sweeps.trials.budget import SCREENING
from sweeps.trials.search_space import POINTS
from sweeps.workers.simulated_worker import run_simulated_worker
from sweeps.workers.worker_pool import run_worker_pool
from sweeps.workers.worker_settings import WorkerSettings

_CONNECTIONS_PER_WORKER = 3
"""Of the lock, of the trial, and of its heartbeat."""
_SPARE_CONNECTIONS = 10
"""Those of this command, and those that the server keeps for administrators."""
_HEARTBEAT_S = 5


def main(arguments: Sequence[str]) -> None:
    """Run simulated trials while workers are killed, count what the database holds, print it."""
    options = _make_parser().parse_args(arguments)
    if options.points > len(POINTS):
        raise InputError(f"--points is {options.points}; the grid has {len(POINTS)}")
    quiet_optuna()
    settings = WorkerSettings(
        storage=options.storage,
        study=options.study,
        budget=SCREENING,
        policy=RetryPolicy(heartbeat_s=_HEARTBEAT_S, grace_s=MISSED_HEARTBEATS * _HEARTBEAT_S),
        folder=Path(),
        threads=1,
    )
    queue = _open_new_study(settings, options.workers)
    queue.enqueue(job_selection.select_points(range(options.points)))
    try:
        with _kill_workers(queue, options) as killed:
            run_worker_pool(
                run_simulated_worker, (settings, options.trial_s), workers=options.workers, queue=queue
            )
        figures = summarise_trials(queue.get_trials(), points=options.points) | {"killed": len(killed)}
    finally:
        queue.storage.rdb.delete_study(queue.study_id)
    figures |= {name: vars(options)[name] for name in ("workers", "trial_s", "seed")} | describe_hardware()
    print(_format_figures(figures))
    if options.json:
        write_json(options.json, figures)
    if figures["missing"] or figures["duplicates"]:
        raise SystemExit(1)


def summarise_trials(trials: Sequence[FrozenTrial], *, points: int) -> dict[str, Any]:
    """Count the points that are complete, missing and complete more than once, and failures by their reason.

    The rate is that from the first claim to the last result.
    """
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    by_job = Counter(trial.user_attrs[JOB] for trial in complete)
    failed = [trial for trial in trials if trial.state is TrialState.FAIL]
    started = [trial.datetime_start for trial in trials if trial.datetime_start]
    ended = [trial.datetime_complete for trial in complete if trial.datetime_complete]
    spent_s = (max(ended) - min(started)).total_seconds() if ended else 0.0
    return {
        "points": points,
        "complete": len(by_job),
        "missing": points - len(by_job),
        "duplicates": len(complete) - len(by_job),
        "failures": dict(Counter(str(trial.user_attrs.get(REASON)) for trial in failed)),
        "spent_s": spent_s,
        "points_per_s": len(by_job) / spent_s if spent_s else 0.0,
    }


def _open_new_study(settings: WorkerSettings, workers: int) -> GridQueue:
    """Create the study of the test. Raises InputError if it exists or the server has too few connections."""
    if "://" not in settings.storage:
        raise InputError(
            f"--storage {settings.storage} is a file, which one machine can use; "
            "name postgresql://USER@HOST:PORT/DATABASE"
        )
    storage = StudyStorage(settings.storage, settings.policy)
    with storage.rdb.engine.connect() as connection:
        allowed = int(connection.execute(sqlalchemy.text("SHOW max_connections")).scalar_one())
    needed = _CONNECTIONS_PER_WORKER * workers + _SPARE_CONNECTIONS
    if allowed < needed:
        raise InputError(
            f"the server allows {allowed} connections and {workers} workers need up to {needed}; "
            f"set max_connections = {needed} in postgresql.conf, or give fewer --workers"
        )
    if settings.study in storage.study_names():
        raise InputError(f"study {settings.study} exists in {settings.storage}; name another --study")
    return settings.open_grid()


@contextmanager
def _kill_workers(queue: GridQueue, options: argparse.Namespace) -> Iterator[list[int]]:
    """Kill a share of the workers at random inside this context; yield the list of killed process ids.

    One is killed each time that another part of the points is complete: while all are at work, not before
    they have started.
    """
    generator = random.Random(options.seed)
    count = round(options.kill * options.workers)
    # Not among the last points: there, workers without a trial wait for the others.
    marks = sorted(generator.uniform(0.05, 0.8) * options.points for _ in range(count))
    killed: list[int] = []
    stopped = threading.Event()

    def kill_at_marks() -> None:
        while len(killed) < count and not stopped.wait(0.1):
            complete = queue.storage.retry_while_offline(queue.count_by_state)[TrialState.COMPLETE]
            while len(killed) < count and complete >= marks[len(killed)]:
                workers = sorted(multiprocessing.active_children(), key=lambda process: process.pid or 0)
                process = generator.choice(workers)
                process.kill()
                killed.append(process.pid or 0)
                # The pool replaces it before the next is chosen.
                time.sleep(0.1)

    thread = threading.Thread(target=kill_at_marks, daemon=True)
    thread.start()
    try:
        yield killed
    finally:
        stopped.set()
        thread.join()


def _format_figures(figures: dict[str, Any]) -> str:
    failures = "; ".join(f"{count} x {reason}" for reason, count in figures["failures"].items())
    return "\n".join(
        [
            "{workers} workers, {killed} of them killed; {points} points of {trial_s:g} s on average".format(
                **figures
            ),
            "{complete} points complete, {missing} missing, {duplicates} duplicates".format(**figures),
            f"failed attempts: {failures or 'none'}",
            "{points_per_s:.1f} points per second over {spent_s:.0f} s".format(**figures),
            "{machine}, {cores} cores, seed {seed}, {date}".format(**figures),
        ]
    )


def _share(text: str) -> float:
    return 0.0 if text == "0" else positive_float(text, most=1.0, what="share")


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("load_test", __doc__, package="sweeps")
    parser.add_argument("--storage", required=True, help="postgresql://USER@HOST:PORT/DATABASE")
    parser.add_argument("--study", default="load_test", help="name of the study that is made and deleted")
    parser.add_argument("--workers", type=positive_int, default=64, help="processes on this machine")
    parser.add_argument(
        "--points", type=positive_int, default=len(POINTS), metavar="N", help="points of the grid"
    )
    parser.add_argument(
        "--trial-s", type=positive_float, default=8.0, metavar="S", help="seconds of a trial on average"
    )
    parser.add_argument(
        "--kill", type=_share, default=1 / 3, metavar="SHARE", help="workers to kill (default: a third)"
    )
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of who is killed, and when")
    return parser


if __name__ == "__main__":
    run_command(main)
