"""Time limit and heartbeats of the trial that a worker runs."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from optuna.exceptions import StorageInternalError
from sqlalchemy.exc import SQLAlchemyError

from sweeps.queue.study_storage import RetryPolicy
from sweeps.queue.trial_queue import ClaimedTrial, TrialQueue

STUCK_STATUS = 75
"""Exit status of a worker whose trial hung."""
_PREPARATION_S = 900.0
"""Time to make pictures and trace a network, which is not the trial's."""


class TrialFailed(Exception):
    """A trial that cannot be completed; the message is its reason."""


class TrialWatchdog:
    """A trial's time, and the heartbeats of the worker that has it, which come from a thread of their own."""

    def __init__(self, book: TrialQueue) -> None:
        self._book, self._rules = book, book.store.rules
        self._claim: ClaimedTrial | None = None
        self._begun, self._stuck_at = 0.0, 0.0
        threading.Thread(target=self._beat, daemon=True).start()

    @contextmanager
    def watching(self, claim: ClaimedTrial) -> Iterator[None]:
        """Send heartbeats for this trial."""
        self._begun, self._stuck_at = 0.0, time.monotonic() + _PREPARATION_S
        self._claim = claim
        try:
            yield
        finally:
            self._claim = None

    def start(self) -> None:
        """From now on the time is the trial's."""
        self._begun = time.monotonic()
        self._stuck_at = self._begun + 2 * self._rules.time_limit_s

    def check(self) -> None:
        """Raise Failed once the trial is over its time limit."""
        if self._begun and time.monotonic() - self._begun > self._rules.time_limit_s:
            raise TrialFailed(timeout_message(self._rules))

    def _beat(self) -> None:
        while True:
            claim = self._claim
            if claim is not None and time.monotonic() > self._stuck_at:
                self._give_up(claim)
            # A beat that does not get through may be followed by one that does; a database that stays away
            # is for the worker itself to notice.
            try:
                if claim is not None:
                    self._book.store.storage.record_heartbeat(claim.trial_id)
            except (StorageInternalError, SQLAlchemyError):
                self._book.store.away_at = time.monotonic()
            time.sleep(self._rules.heartbeat_s)

    def _give_up(self, claim: ClaimedTrial) -> None:
        """End the process: what does not come back from a step cannot be ended otherwise."""
        try:
            self._book.fail(claim, f"{timeout_message(self._rules)}, and stuck")
        finally:
            os._exit(STUCK_STATUS)


def timeout_message(rules: RetryPolicy) -> str:
    """The reason of a trial over its time limit."""
    return f"over its time limit of {rules.time_limit_s:g} s"
