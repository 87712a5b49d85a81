"""Measure what a trial costs besides its training steps, and what sharing compiled steps saves.

The trials are those of a worker at its screening budget, from claim to end, in a study of their own. Overhead
is all time of a trial except its steps: claiming, resetting, evaluating, artifacts, the storage, and building
and tracing networks, averaged over the run. Its CPU time shows what it would be on an idle machine. The trial
without sharing builds and traces its own network.
"""

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.hardware import describe_hardware, peak_rss_mb
from laesi_tf.common.parsing import positive_int
from laesi_tf.common.progress import progress_bar
from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage, quiet_optuna
from sweeps.queue.trial_queue import ClaimedTrial, Job
from sweeps.trials.budget import SCREENING, Budget, add_budget_arguments, budget_from_args
from sweeps.trials.search_space import FACTORS, POINTS
from sweeps.workers.watchdog import TrialWatchdog
from sweeps.workers.worker import TrialResult, run_trials

if TYPE_CHECKING:
    from sweeps.trials.training_data import TrainingData

_UNSHARED_TRIALS = 2
_TIMES = ("steps_s", "steps_cpu_s", "judging_s")
_WARMUP_TRIALS = 10
"""Trials after which memory should have stopped growing."""


def main(arguments: Sequence[str]) -> None:
    """Run the trials, print what they cost."""
    options = _make_parser().parse_args(arguments)
    budget = budget_from_args(options, SCREENING)
    load_tensorflow(threads=options.threads)
    quiet_optuna()
    from sweeps.trials.training_data import TrainingData

    data = TrainingData(budget, threads=options.threads)
    costs = measure_trial_cost(budget, data, job_selection.select_points(range(options.trials)))
    costs["naive_trial_s"] = measure_unshared_trial_s(budget, data)
    costs |= {"threads": options.threads, "budget": budget.to_attributes(), **describe_hardware()}
    if options.json:
        write_json(options.json, costs)
    print(_format_table(costs))


def measure_trial_cost(budget: Budget, data: "TrainingData", jobs: Sequence[Job]) -> dict[str, Any]:
    """Measure seconds per trial over a worker's run of `jobs`, with a storage in a file, and its memory."""
    from sweeps.trials.trial_runner import TrialRunner
    from sweeps.workers.objective import TrainingObjective

    memory_mb: list[float] = []
    with tempfile.TemporaryDirectory() as folder, tqdm(total=len(jobs), unit="trial", delay=2) as bar:
        queue = GridQueue(StudyStorage(str(Path(folder) / "study.db"), RetryPolicy()), "benchmark", FACTORS)
        queue.enqueue(jobs)
        objective = TrainingObjective(TrialRunner(budget, data), queue, Path(folder))

        def measure_trial(claim: ClaimedTrial, watchdog: TrialWatchdog) -> TrialResult:
            memory_mb.append(peak_rss_mb())
            bar.update()
            return objective(claim, watchdog)

        started, started_cpu = time.perf_counter(), time.process_time()
        run_trials(queue, measure_trial)
        spent_s, spent_cpu_s = time.perf_counter() - started, time.process_time() - started_cpu
        complete = [history.complete for history in queue.job_histories().values() if history.complete]
    mean = {key: sum(trial.user_attrs[key] for trial in complete) / len(complete) for key in _TIMES}
    return {
        "trials": len(complete),
        "trial_s": spent_s / len(complete),
        "overhead_s": spent_s / len(complete) - mean["steps_s"],
        **mean,
        "trial_cpu_s": spent_cpu_s / len(complete),
        "overhead_cpu_s": spent_cpu_s / len(complete) - mean["steps_cpu_s"],
        "peak_rss_mb": peak_rss_mb(),
        "settled_rss_mb": memory_mb[min(_WARMUP_TRIALS, len(memory_mb) - 1)],
    }


def measure_unshared_trial_s(budget: Budget, data: "TrainingData") -> float:
    """Return the mean seconds of a trial that builds and traces its own network, without rendering images."""
    from sweeps.trials.trial_runner import TrialRunner

    started = time.perf_counter()
    for point in progress_bar(POINTS[:_UNSHARED_TRIALS], desc="trials without sharing", unit="trial"):
        TrialRunner(budget, data).run(point, job_selection.SCREENING_SEED)
    return (time.perf_counter() - started) / _UNSHARED_TRIALS


def _format_table(costs: dict[str, Any]) -> str:
    rows = {
        "trial": "trial_s",
        "  steps": "steps_s",
        "  overhead": "overhead_s",
        "    of which evaluation": "judging_s",
        "trial that builds and traces its own network": "naive_trial_s",
        "CPU time of a trial": "trial_cpu_s",
        "  of its overhead": "overhead_cpu_s",
    }
    lines = [f"{label:46}{costs[key]:8.2f} s" for label, key in rows.items()]
    memory = "{settled_rss_mb:.0f} MB after ten trials, {peak_rss_mb:.0f} MB at the end".format(**costs)
    machine = "{trials} trials, {threads} threads, {machine}, TensorFlow {tensorflow}, {date}".format(**costs)
    return "\n".join([*lines, f"peak memory {memory}", machine])


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("benchmark", __doc__, package="sweeps")
    parser.add_argument(
        "--trials",
        type=positive_int,
        default=50,
        metavar="N",
        help="trials: points of the grid from number 0",
    )
    parser.add_argument("--threads", type=positive_int, default=1, help="threads of the worker")
    add_budget_arguments(parser, SCREENING)
    return parser


if __name__ == "__main__":
    run_command(main)
