"""A worker whose trials do as their level says, in place of training. For tests that kill it."""

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

RULES = RetryPolicy(retries=2, time_limit_s=1.0, heartbeat_s=1, grace_s=3, patience_s=60.0)
KINDS = (
    "good",
    "raises_once",
    "raises",
    "diverges",
    "no_number",
    "slow_once",
    "stuck_once",
    "dies_once",
    "long",
)
FACTORS = {"kind": KINDS}


def job(number: int, kind: str) -> Job:
    """A job that behaves as `kind` says."""
    return Job(f"{number:04d}", {"kind": kind}, seed=number)


def ledger(storage: str, rules: RetryPolicy = RULES) -> GridQueue:
    """The tests' study."""
    return GridQueue(StudyStorage(storage, rules), "study", FACTORS, group=lambda job: int(job.name) // 10)


def objective(log: Path, claim: ClaimedTrial, clock: TrialWatchdog) -> TrialResult:
    """Do what the job's level says, and write down that it was begun."""
    kind = claim.job.levels["kind"]
    with log.open("a") as file:
        file.write(f"{claim.job.name} {claim.attempt} {os.getpid()}\n")
    clock.start()
    time.sleep(0.02)
    if kind == "raises" or (kind == "raises_once" and claim.attempt == 1):
        raise ValueError("as it was told")
    if kind == "diverges":
        raise TrialFailed("training diverged: nan at step 3")
    if kind == "long":
        time.sleep(0.9)
    if claim.attempt == 1:
        _misbehave(kind, clock)
    value = float("nan") if kind == "no_number" else float(claim.job.seed)
    return TrialResult([value, 1.0], {"images_per_s": 100.0})


def _misbehave(kind: str, clock: TrialWatchdog) -> None:
    if kind == "dies_once":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "stuck_once":
        time.sleep(600)
    while kind == "slow_once":
        clock.check()
        time.sleep(0.05)


def target(storage: str, log: str) -> None:
    """Work until the study is done."""
    worker_pool.install_signal_handlers()
    run_trials(
        ledger(storage),
        lambda claim, clock: objective(Path(log), claim, clock),
        wanted=lambda: not worker_pool.supervisor_is_gone(),
    )


if __name__ == "__main__":
    target(*sys.argv[1:])
