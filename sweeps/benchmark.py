"""Measure what a trial of the search costs beside its training steps, and what sharing compiled steps saves.

Trials are those of a worker at its screening budget, from claim to end, in a study of their own. Overhead
is all of a trial's time but its steps: claiming, resetting, judging, artifacts, the storage, and the
building and tracing of networks spread over the run. Its CPU time says what it would be on a machine that
does nothing else. The naive trial builds and traces its network for itself.
"""

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.hardware import describe_hardware, peak_rss_mb
from laesi_tf.common.parsing import positive_int
from laesi_tf.common.progress import progress_bar

# isort: split
import numpy as np
import tensorflow as tf

from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.trial_queue import Job
from sweeps.trials.budget import SCREENING, Budget
from sweeps.trials.budget_arguments import add_budget_arguments, budget_from_args
from sweeps.trials.objective import TrainingObjective
from sweeps.trials.search_space import FACTORS, POINTS
from sweeps.trials.training_data import TrainingData
from sweeps.trials.trial_runner import TrialRunner
from sweeps.workers.worker import run_trials

_NAIVE_TRIALS = 2
_TIMES = ("steps_s", "steps_cpu_s", "judging_s")
_WARMUP_TRIALS = 10
"""Trials after which memory should have stopped growing."""


def main(arguments: Sequence[str]) -> None:
    """Run the trials, tell what they cost."""
    options = _make_parser().parse_args(arguments)
    if options.json:
        require_writable(options.json)
    tf.config.threading.set_intra_op_parallelism_threads(options.threads)
    tf.config.threading.set_inter_op_parallelism_threads(options.threads)
    budget = budget_from_args(options, SCREENING)
    pictures = TrainingData(budget, threads=options.threads)
    figures = measure_trial_cost(budget, pictures, job_selection.select_points(range(options.trials)))
    figures["naive_trial_s"] = measure_naive_trial_s(budget, pictures)
    figures |= {"threads": options.threads, "budget": budget.told(), **describe_hardware()}
    if options.json:
        write_json(options.json, figures)
    print(_format_table(figures))


def measure_trial_cost(budget: Budget, pictures: TrainingData, chosen: Sequence[Job]) -> dict[str, Any]:
    """Seconds per trial over a worker's run of `chosen` jobs, with a storage in a file, and its memory."""
    held: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        ledger = GridQueue(StudyStorage(str(Path(folder) / "study.db"), RetryPolicy()), "benchmark", FACTORS)
        ledger.fill(chosen)
        objective = TrainingObjective(TrialRunner(budget, pictures), ledger, Path(folder))
        bar = iter(progress_bar(range(len(chosen)), desc="trials", unit="trial"))

        def measured(claim: Any, clock: Any) -> Any:
            held.append(peak_rss_mb())
            next(bar)
            return objective(claim, clock)

        begun, used = time.perf_counter(), time.process_time()
        run_trials(ledger, measured)
        spent, used = time.perf_counter() - begun, time.process_time() - used
        ended = [standing.complete for standing in ledger.standings().values() if standing.complete]
    mean = {key: float(np.mean([t.user_attrs[key] for t in ended])) for key in _TIMES}
    return {
        "trials": len(ended),
        "trial_s": spent / len(ended),
        "overhead_s": spent / len(ended) - mean["steps_s"],
        **mean,
        "trial_cpu_s": used / len(ended),
        "overhead_cpu_s": used / len(ended) - mean["steps_cpu_s"],
        "peak_rss_mb": peak_rss_mb(),
        "settled_rss_mb": held[min(_WARMUP_TRIALS, len(held) - 1)],
    }


def measure_naive_trial_s(budget: Budget, pictures: TrainingData) -> float:
    """Mean seconds of a trial that builds and traces its network; pictures and TensorFlow are there."""
    begun = time.perf_counter()
    for point in progress_bar(POINTS[:_NAIVE_TRIALS], desc="naive trials", unit="trial"):
        TrialRunner(budget, pictures).run(point, job_selection.SCREENING_SEED)
    return (time.perf_counter() - begun) / _NAIVE_TRIALS


def _format_table(figures: dict[str, Any]) -> str:
    rows = {
        "trial": "trial_s",
        "  of which its steps": "steps_s",
        "  overhead": "overhead_s",
        "    of which judging": "judging_s",
        "trial that builds and traces for itself": "naive_trial_s",
        "CPU time of a trial": "trial_cpu_s",
        "  of its overhead": "overhead_cpu_s",
    }
    lines = [f"{what:42}{figures[key]:8.2f} s" for what, key in rows.items()]
    memory = "{settled_rss_mb:.0f} MB after ten trials, {peak_rss_mb:.0f} MB at the end".format(**figures)
    machine = "{trials} trials, {threads} threads, {machine}, TensorFlow {tensorflow}, {date}".format(
        **figures
    )
    return "\n".join([*lines, f"peak memory {memory}", machine])


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("benchmark", __doc__, package="sweeps")
    made.add_argument(
        "--trials", type=positive_int, default=50, metavar="N", help="trials of the grid, from its first"
    )
    made.add_argument("--threads", type=positive_int, default=1, help="threads of the worker")
    add_budget_arguments(made)
    return made


if __name__ == "__main__":
    run_command(main)
