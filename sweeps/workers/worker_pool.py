"""Run several worker processes on this machine: start them, replace those that die, end them together."""

import multiprocessing
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from typing import Any

from optuna.trial import TrialState
from tqdm import tqdm

from laesi_tf.common.errors import InputError
from sweeps.queue.trial_queue import TrialQueue

_POLL_S = 1.0
_SHUTDOWN_S = 60.0
"""What workers get to hand back their trials when they are asked to end."""
_BAD_INPUT_STATUS = 2
"""Exit status of a command that was asked for what cannot be; it has said what."""
_MAX_DEATHS = 8
"""Deaths without a trial completed in between, after which replacing workers is of no use."""


def run_worker_pool(
    target: Callable[..., None], arguments: tuple[Any, ...], *, workers: int, book: TrialQueue, total: int
) -> None:
    """Run `target(*arguments)` in `workers` processes until each has returned, replacing those that die.

    `target` must be importable; the progress bar goes to `total` trials. Raises InputError if a worker was
    given bad input, and RuntimeError if they die and die. However this ends, they are asked to end too and
    given a minute.
    """
    context = multiprocessing.get_context("spawn")
    crew: list[BaseProcess] = []

    def hire() -> BaseProcess:
        made = context.Process(target=target, args=arguments)
        made.start()
        return made

    with _terminate_on_exit(crew), _progress_bar(book, total) as show:
        crew.extend(hire() for _ in range(workers))
        deaths, complete = 0, 0
        while any(member.exitcode != 0 for member in crew):
            for place, member in enumerate(crew):
                if member.exitcode == _BAD_INPUT_STATUS:
                    raise InputError("a worker was given bad input and has said which")
                if member.exitcode:
                    deaths += 1
                    if deaths > _MAX_DEATHS:
                        raise RuntimeError(f"workers die: {deaths} times, the last with {member.exitcode}")
                    crew[place] = hire()
            before, complete = complete, show()
            deaths = deaths if complete == before else 0
            time.sleep(_POLL_S)
        show()


def supervisor_is_gone() -> bool:
    """Whether this worker's supervisor is gone: then no one wants it any more."""
    parent = multiprocessing.parent_process()
    return parent is not None and not parent.is_alive()


def install_signal_handlers() -> None:
    """Let SIGTERM end this worker as Ctrl-C does, with time to hand back what it holds.

    Ctrl-C itself goes to all processes of a terminal: the supervisor passes it on, so that it comes once.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)


@contextmanager
def _terminate_on_exit(crew: list[BaseProcess]) -> Iterator[None]:
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
        for member in crew:
            if member.exitcode is None:
                member.terminate()
        deadline = time.monotonic() + _SHUTDOWN_S
        for member in crew:
            member.join(max(0.0, deadline - time.monotonic()))
            if member.exitcode is None:
                member.kill()


@contextmanager
def _progress_bar(book: TrialQueue, total: int) -> Iterator[Callable[[], int]]:
    """A progress bar, and what brings it up to date and tells how many trials have ended well."""

    def ended() -> tuple[int, int]:
        now = book.store.patiently(book.counts)
        return now[TrialState.COMPLETE] + now[TrialState.PRUNED], now[TrialState.FAIL]

    with tqdm(initial=ended()[0], total=total, unit="trial", dynamic_ncols=True, file=sys.stderr) as bar:

        def show() -> int:
            well, failed = ended()
            bar.set_postfix_str(f"{failed} attempts failed", refresh=False)
            bar.update(well - bar.n)
            return well

        yield show
