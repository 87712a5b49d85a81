"""A worker whose trials behave as their level says, in place of training. For tests that kill it."""

import os
import signal
import sys
import time
from pathlib import Path

from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.trial_queue import ClaimedTrial, Job
from sweeps.workers import worker_pool
from sweeps.workers.watchdog import TrialFailed, TrialWatchdog
from sweeps.workers.worker import TrialResult, run_trials

POLICY = RetryPolicy(retries=2, time_limit_s=1.0, heartbeat_s=1, grace_s=3, patience_s=60.0)
BEHAVIOURS = (
    "good",
    "raises_once",
    "raises",
    "diverges",
    "not_finite",
    "slow_once",
    "stuck_once",
    "dies_once",
    "long",
    "held",
)
FACTORS = {"behaviour": BEHAVIOURS}


def make_job(number: int, behaviour: str) -> Job:
    """Return a job that behaves as `behaviour` says."""
    return Job(f"{number:04d}", {"behaviour": behaviour}, seed=number)


def open_queue(storage: str, policy: RetryPolicy = POLICY) -> GridQueue:
    """Open the tests' study, in which ten jobs in a row are a group."""
    return GridQueue(StudyStorage(storage, policy), "study", FACTORS, group=lambda job: int(job.name) // 10)


def release_file(log: Path) -> Path:
    """Return the file whose existence lets held trials go on."""
    return log.with_suffix(".released")


def objective(log: Path, claim: ClaimedTrial, watchdog: TrialWatchdog) -> TrialResult:
    """Behave as the job's level says, and log that it was started."""
    behaviour = claim.job.levels["behaviour"]
    with log.open("a") as file:
        file.write(f"{claim.job.name} {claim.attempt} {os.getpid()}\n")
    while behaviour == "held" and not release_file(log).exists():
        time.sleep(0.02)
    watchdog.start_clock()
    time.sleep(0.02)
    if behaviour == "raises" or (behaviour == "raises_once" and claim.attempt == 1):
        raise ValueError("raised on purpose")
    if behaviour == "diverges":
        raise TrialFailed("training diverged: nan at step 3")
    if behaviour == "long":
        time.sleep(0.9)
    if claim.attempt == 1:
        _misbehave_once(behaviour, watchdog)
    value = float("nan") if behaviour == "not_finite" else float(claim.job.seed)
    return TrialResult([value, 1.0], {"images_per_s": 100.0})


def _misbehave_once(behaviour: str, watchdog: TrialWatchdog) -> None:
    if behaviour == "dies_once":
        os.kill(os.getpid(), signal.SIGKILL)
    if behaviour == "stuck_once":
        time.sleep(600)
    while behaviour == "slow_once":
        watchdog.check_timeout()
        time.sleep(0.05)


def run_worker(storage: str, log: str) -> None:
    """Run trials until the study is finished."""
    worker_pool.install_signal_handlers()
    run_trials(
        open_queue(storage),
        lambda claim, watchdog: objective(Path(log), claim, watchdog),
        should_continue=lambda: not worker_pool.supervisor_is_gone(),
    )


if __name__ == "__main__":
    run_worker(*sys.argv[1:])
