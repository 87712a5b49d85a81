"""Run several worker processes on this machine: start them, replace those that die, stop them together."""

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
_GRACE_S = 60.0
"""Grace period in seconds for a worker to release its trial on SIGTERM."""
_BAD_INPUT_STATUS = 2
"""Exit status of a command that was given bad input and has printed what is wrong."""
_MAX_DEATHS = 8
"""Deaths without a completed trial in between, after which replacing workers does not help."""


def run_worker_pool(
    target: Callable[..., None], arguments: tuple[Any, ...], *, workers: int, queue: TrialQueue
) -> None:
    """Run `target(*arguments)` in `workers` processes until all have returned, replacing those that die.

    `target` must be importable. Raises InputError if a worker was given bad input, and RuntimeError if
    workers keep dying. However this ends, the workers get SIGTERM and a grace period.
    """
    context = multiprocessing.get_context("spawn")
    pool: list[BaseProcess] = []

    def start_worker() -> BaseProcess:
        process = context.Process(target=target, args=arguments)
        process.start()
        return process

    with _terminate_on_exit(pool), _progress_bar(queue) as update:
        pool.extend(start_worker() for _ in range(workers))
        deaths, complete = 0, 0
        while any(process.exitcode != 0 for process in pool):
            for index, process in enumerate(pool):
                if process.exitcode == _BAD_INPUT_STATUS:
                    raise InputError("a worker was given bad input and has printed what is wrong")
                if process.exitcode:
                    deaths += 1
                    if deaths > _MAX_DEATHS:
                        raise RuntimeError(
                            f"{deaths} workers died in a row, the last with exit status {process.exitcode}"
                        )
                    pool[index] = start_worker()
            before, complete = complete, update()
            deaths = deaths if complete == before else 0
            time.sleep(_POLL_S)
        update()


def supervisor_is_gone() -> bool:
    """Return whether this worker's supervisor has exited: then the worker must end too."""
    parent = multiprocessing.parent_process()
    return parent is not None and not parent.is_alive()


def install_signal_handlers() -> None:
    """Let SIGTERM interrupt this worker as Ctrl-C does, with time to release its trial.

    Ctrl-C goes to all processes of a terminal; the supervisor passes it on as SIGTERM, so that each worker
    gets it once.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)


@contextmanager
def _terminate_on_exit(pool: list[BaseProcess]) -> Iterator[None]:
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
        for process in pool:
            if process.exitcode is None:
                process.terminate()
        deadline = time.monotonic() + _GRACE_S
        for process in pool:
            process.join(max(0.0, deadline - time.monotonic()))
            if process.exitcode is None:
                process.kill()


@contextmanager
def _progress_bar(queue: TrialQueue) -> Iterator[Callable[[], int]]:
    """Show a progress bar; yield a function that updates it and returns how many trials have succeeded."""
    retry = queue.storage.retry_while_offline

    def count_ended() -> tuple[int, int]:
        counts = retry(queue.count_by_state)
        return counts[TrialState.COMPLETE] + counts[TrialState.PRUNED], counts[TrialState.FAIL]

    with tqdm(
        initial=count_ended()[0],
        total=retry(queue.expected_total),
        unit="trial",
        dynamic_ncols=True,
        file=sys.stderr,
    ) as bar:

        def update() -> int:
            succeeded, failed = count_ended()
            bar.set_postfix_str(f"{failed} attempts failed", refresh=False)
            bar.update(succeeded - bar.n)
            return succeeded

        yield update
