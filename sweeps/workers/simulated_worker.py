"""A worker process whose trials only wait, to test a database with many workers without their trainings."""

import random
import time

from laesi_tf.cli.console import run_command
from sweeps.queue.study_storage import quiet_optuna
from sweeps.queue.trial_queue import ClaimedTrial
from sweeps.workers import worker_pool
from sweeps.workers.watchdog import TrialWatchdog
from sweeps.workers.worker import TrialResult, run_trials
from sweeps.workers.worker_settings import WorkerSettings


def run_simulated_worker(settings: WorkerSettings, trial_s: float) -> None:
    """Run trials that wait `trial_s` seconds on average until none is left; TensorFlow is not loaded."""
    worker_pool.install_signal_handlers()
    quiet_optuna()
    run_command(lambda _: _run_worker(settings, trial_s))


def _run_worker(settings: WorkerSettings, trial_s: float) -> None:
    queue = settings.open_queue_patiently()

    def wait(claim: ClaimedTrial, watchdog: TrialWatchdog) -> TrialResult:
        watchdog.start_clock()
        # Half to one and a half times as long, always the same for the same job.
        share = random.Random(claim.job.name).uniform(0.5, 1.5)
        time.sleep(trial_s * share)
        return TrialResult([100.0 * share, 1.0], {"images_per_s": 1.0})

    run_trials(queue, wait, should_continue=lambda: not worker_pool.supervisor_is_gone())
