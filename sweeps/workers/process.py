"""The entry point of a worker process."""

import time

import tensorflow as tf

from laesi_tf.cli.console import run_command
from laesi_tf.common.errors import InputError
from sweeps.queue.trial_queue import TrialQueue
from sweeps.trials.objective import TrainingObjective
from sweeps.trials.training_data import TrainingData
from sweeps.trials.trial_runner import TrialRunner
from sweeps.workers import worker_pool
from sweeps.workers.worker import run_trials
from sweeps.workers.worker_settings import WorkerSettings

_RETRY_PAUSE_S = 2.0


def run_worker_process(orders: WorkerSettings) -> None:
    """Work at the study until nothing is left or the supervisor is gone; ends as a command does."""
    worker_pool.install_signal_handlers()
    run_command(lambda _: _run_worker(orders))


def _run_worker(orders: WorkerSettings) -> None:
    # This worker's share of the cores.
    tf.config.threading.set_intra_op_parallelism_threads(orders.threads)
    tf.config.threading.set_inter_op_parallelism_threads(orders.threads)
    trainer = TrialRunner(orders.budget, TrainingData(orders.budget, threads=orders.threads))
    book = _open_queue(orders)
    run_trials(
        book,
        TrainingObjective(trainer, book, orders.folder),
        wanted=lambda: not worker_pool.supervisor_is_gone(),
    )


def _open_queue(orders: WorkerSettings) -> TrialQueue:
    """The study's book. The command has opened it before: where that fails now the database is away."""
    begun = time.monotonic()
    while True:
        try:
            return orders.open()
        except InputError:
            if time.monotonic() - begun > orders.rules.patience_s:
                raise
            time.sleep(_RETRY_PAUSE_S)
