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
"""After so many it is not the trials: the worker stops before it has spent everyone's retries."""


@dataclass(frozen=True)
class TrialResult:
    """The values of a trial's objectives, and its user attributes."""

    values: Sequence[float]
    attributes: Mapping[str, Any]


Objective = Callable[[ClaimedTrial, TrialWatchdog], TrialResult]


def run_trials(book: TrialQueue, objective: Objective, *, wanted: Callable[[], bool] = lambda: True) -> None:
    """Work off the study's trials with `objective`, waiting for those of others, while `wanted` says so.

    What `objective` raises fails its trial; InputError and Ctrl-C also end the worker, the trial being queued
    again at no cost. Raises store.Unreachable when the database stays away.
    """
    store, failures = book.store, 0
    clock = TrialWatchdog(book)
    while wanted():
        claim = store.patiently(book.claim)
        if claim is not None:
            reason = _run_trial(book, clock, claim, objective)
            failures = failures + 1 if reason else 0
            if failures == _MAX_CONSECUTIVE_FAILURES:
                raise RuntimeError(f"{failures} trials in a row failed, the last: {reason}")
        elif store.patiently(book.finished):
            return
        else:
            time.sleep(store.rules.heartbeat_s)


def _run_trial(book: TrialQueue, clock: TrialWatchdog, claim: ClaimedTrial, objective: Objective) -> str:
    """Do a claimed trial and tell how it ended; the reason if it failed."""
    store, begun = book.store, time.monotonic()
    try:
        with clock.watching(claim):
            done = objective(claim, clock)
        if not all(math.isfinite(value) for value in done.values):
            raise TrialFailed(f"the result is no number: {list(done.values)}")
    except (InputError, KeyboardInterrupt) as error:
        stopped = f"stopped: {_describe_error(error)}"
        store.patiently(lambda: book.fail(claim, stopped, counts=False))
        raise
    except Exception as error:
        reason = _describe_error(error)
        store.patiently(lambda: book.fail(claim, reason))
        return reason
    attributes = {
        **done.attributes,
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "attempt": claim.attempt,
        "trial_s": time.monotonic() - begun,
    }

    def finish() -> None:
        away = {"interrupted": store.interruption} if store.interruption else {}
        book.finish(claim, done.values, {**attributes, **away})

    store.patiently(finish)
    store.interruption = ""
    return ""


def _describe_error(error: BaseException) -> str:
    if isinstance(error, TrialFailed):
        return str(error)
    text = " ".join(str(error).split())[:500]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
