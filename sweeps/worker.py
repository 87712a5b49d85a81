"""One worker: claims trials, has them done, tells how they ended, until nothing is left to do."""

import math
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from optuna.exceptions import StorageInternalError
from sqlalchemy.exc import SQLAlchemyError

from laesi_tf.errors import InputError
from sweeps.book import Book, Claim
from sweeps.store import Rules

STUCK = 75
"""Exit status of a worker whose trial hung."""
_PREPARATION_S = 900.0
"""Time to make pictures and trace a network, which is not the trial's."""
_FAILURES_IN_A_ROW = 10
"""After so many it is not the trials: the worker stops before it has spent everyone's retries."""


class Failed(Exception):
    """A trial that cannot be completed; the message is its reason."""


@dataclass(frozen=True)
class Done:
    """The values of a trial's objectives, and its user attributes."""

    values: Sequence[float]
    attributes: Mapping[str, Any]


class Clock:
    """A trial's time, and the heartbeats of the worker that has it, which come from a thread of their own."""

    def __init__(self, book: Book) -> None:
        self._book, self._rules = book, book.store.rules
        self._claim: Claim | None = None
        self._begun, self._stuck_at = 0.0, 0.0
        threading.Thread(target=self._beat, daemon=True).start()

    @contextmanager
    def watching(self, claim: Claim) -> Iterator[None]:
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
            raise Failed(over_time(self._rules))

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

    def _give_up(self, claim: Claim) -> None:
        """End the process: what does not come back from a step cannot be ended otherwise."""
        try:
            self._book.fail(claim, f"{over_time(self._rules)}, and stuck")
        finally:
            os._exit(STUCK)


def over_time(rules: Rules) -> str:
    """The reason of a trial over its time limit."""
    return f"over its time limit of {rules.time_limit_s:g} s"


Objective = Callable[[Claim, Clock], Done]


def work(book: Book, objective: Objective, *, wanted: Callable[[], bool] = lambda: True) -> None:
    """Work off the study's trials with `objective`, waiting for those of others, while `wanted` says so.

    What `objective` raises fails its trial; InputError and Ctrl-C also end the worker, the trial being queued
    again at no cost. Raises store.Unreachable when the database stays away.
    """
    store, failures = book.store, 0
    clock = Clock(book)
    while wanted():
        claim = store.patiently(book.claim)
        if claim is not None:
            reason = _attempt(book, clock, claim, objective)
            failures = failures + 1 if reason else 0
            if failures == _FAILURES_IN_A_ROW:
                raise RuntimeError(f"{failures} trials in a row failed, the last: {reason}")
        elif store.patiently(book.finished):
            return
        else:
            time.sleep(store.rules.heartbeat_s)


def _attempt(book: Book, clock: Clock, claim: Claim, objective: Objective) -> str:
    """Do a claimed trial and tell how it ended; the reason if it failed."""
    store, begun = book.store, time.monotonic()
    try:
        with clock.watching(claim):
            done = objective(claim, clock)
        if not all(math.isfinite(value) for value in done.values):
            raise Failed(f"the result is no number: {list(done.values)}")
    except (InputError, KeyboardInterrupt) as error:
        stopped = f"stopped: {_told(error)}"
        store.patiently(lambda: book.fail(claim, stopped, counts=False))
        raise
    except Exception as error:
        reason = _told(error)
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


def _told(error: BaseException) -> str:
    if isinstance(error, Failed):
        return str(error)
    text = " ".join(str(error).split())[:500]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
