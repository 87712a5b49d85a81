"""The loop of one worker: claim a trial, run it, record how it ended, until none is left."""

import math
import os
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from laesi_tf.common.errors import InputError
from sweeps.queue.trial_queue import ClaimedTrial, TrialQueue
from sweeps.workers.watchdog import TrialFailed, TrialWatchdog

_MAX_CONSECUTIVE_FAILURES = 10
"""After so many failures the cause is not the trials: the worker stops before all retries are used up."""


@dataclass(frozen=True)
class TrialResult:
    """The values of a trial's objectives, and its user attributes."""

    values: Sequence[float]
    attributes: Mapping[str, Any]


Objective = Callable[[ClaimedTrial, TrialWatchdog], TrialResult]


def run_trials(
    queue: TrialQueue, objective: Objective, *, should_continue: Callable[[], bool] = lambda: True
) -> None:
    """Run the study's trials with `objective` until all are done, also by other workers.

    An exception of `objective` fails its trial. InputError and KeyboardInterrupt also end the worker; the
    trial is then queued again without counting as a failure. Raises StorageUnreachable when the database
    stays offline, and RuntimeError after too many failures in a row.
    """
    storage, failures = queue.storage, 0
    watchdog = TrialWatchdog(queue)
    while should_continue():
        claim = storage.retry_while_offline(queue.claim)
        if claim is not None:
            reason = _run_trial(queue, watchdog, claim, objective)
            failures = failures + 1 if reason else 0
            if failures == _MAX_CONSECUTIVE_FAILURES:
                raise RuntimeError(f"{failures} trials in a row failed, the last: {reason}")
        elif storage.retry_while_offline(queue.is_finished):
            return
        else:
            time.sleep(storage.policy.heartbeat_s)


def _run_trial(queue: TrialQueue, watchdog: TrialWatchdog, claim: ClaimedTrial, objective: Objective) -> str:
    """Run a claimed trial and record how it ended; return the reason if it failed."""
    # Heartbeats until the end is recorded: that may take longer than a lost worker is waited for.
    with watchdog.watch(claim):
        return _run_watched_trial(queue, watchdog, claim, objective)


def _run_watched_trial(
    queue: TrialQueue, watchdog: TrialWatchdog, claim: ClaimedTrial, objective: Objective
) -> str:
    storage, started = queue.storage, time.monotonic()
    try:
        try:
            result = objective(claim, watchdog)
        finally:
            watchdog.stop_clock()
        if not all(math.isfinite(value) for value in result.values):
            raise TrialFailed(f"the result is not finite: {list(result.values)}")
    except (InputError, KeyboardInterrupt) as error:
        stopped = f"stopped: {_describe_error(error)}"
        storage.retry_while_offline(lambda: queue.fail(claim, stopped, counts=False))
        raise
    except Exception as error:
        reason = _describe_error(error)
        storage.retry_while_offline(lambda: queue.fail(claim, reason))
        return reason
    attributes = {
        **result.attributes,
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "attempt": claim.attempt,
        "trial_s": time.monotonic() - started,
    }

    def finish() -> None:
        outage = {"interrupted": storage.last_outage} if storage.last_outage else {}
        queue.finish(claim, result.values, {**attributes, **outage})

    storage.retry_while_offline(finish)
    storage.last_outage = ""
    return ""


def _describe_error(error: BaseException) -> str:
    if isinstance(error, TrialFailed):
        return str(error)
    text = " ".join(str(error).split())[:500]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
