"""Time limit and heartbeats of the trial that a worker runs."""

import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from optuna.exceptions import StorageInternalError
from sqlalchemy.exc import SQLAlchemyError

from sweeps.queue import optuna_adapter
from sweeps.queue.study_storage import RetryPolicy
from sweeps.queue.trial_queue import ClaimedTrial, TrialQueue

STUCK_STATUS = 75
"""Exit status of a worker whose trial does not return."""
_PREPARATION_S = 900.0
"""Time to render images and trace a network, which does not count as the trial's."""


class TrialFailed(Exception):
    """A trial that cannot be completed; the message is its reason."""


class TrialWatchdog:
    """Times the worker's trial and sends heartbeats for it, from a thread of its own."""

    def __init__(self, queue: TrialQueue) -> None:
        self._queue, self._policy = queue, queue.storage.policy
        self._claim: ClaimedTrial | None = None
        self._started, self._stuck_at = 0.0, 0.0
        threading.Thread(target=self._send_heartbeats, daemon=True).start()

    @contextmanager
    def watch(self, claim: ClaimedTrial) -> Iterator[None]:
        """Send heartbeats for this trial inside the context."""
        self._started, self._stuck_at = 0.0, time.monotonic() + _PREPARATION_S
        self._claim = claim
        try:
            yield
        finally:
            self._claim = None

    def start_clock(self) -> None:
        """Start to count the trial's time: preparation is over."""
        self._started = time.monotonic()
        self._stuck_at = self._started + 2 * self._policy.time_limit_s

    def stop_clock(self) -> None:
        """Stop to count the trial's time: it has ended, and only its end remains to be recorded."""
        self._started, self._stuck_at = 0.0, math.inf

    def check_timeout(self) -> None:
        """Raise TrialFailed once the trial has run for longer than its time limit."""
        if self._started and time.monotonic() - self._started > self._policy.time_limit_s:
            raise TrialFailed(timeout_message(self._policy))

    def _send_heartbeats(self) -> None:
        while True:
            claim = self._claim
            if claim is not None and time.monotonic() > self._stuck_at:
                self._exit_stuck(claim)
            # One heartbeat may be lost; the worker's own queries notice a database that stays offline.
            try:
                if claim is not None:
                    optuna_adapter.send_heartbeat(self._queue.storage.rdb, claim.trial_id)
            except (StorageInternalError, SQLAlchemyError):
                self._queue.storage.last_offline_at = time.monotonic()
            time.sleep(self._policy.heartbeat_s)

    def _exit_stuck(self, claim: ClaimedTrial) -> None:
        """Exit the process: a training step that does not return cannot be interrupted otherwise."""
        try:
            self._queue.fail(claim, f"{timeout_message(self._policy)}, and stuck")
        finally:
            os._exit(STUCK_STATUS)


def timeout_message(policy: RetryPolicy) -> str:
    """Return the reason of a trial that ran for longer than its time limit."""
    return f"over its time limit of {policy.time_limit_s:g} s"
