"""A worker's process, from its start to its end."""

import time

import tensorflow as tf

from laesi_tf.cli import run
from laesi_tf.errors import InputError
from sweeps import crew
from sweeps.book import Book
from sweeps.objective import Training
from sweeps.orders import Orders
from sweeps.pictures import Pictures
from sweeps.trainer import Trainer
from sweeps.worker import work

_PAUSE_S = 2.0


def employ(orders: Orders) -> None:
    """Work at the study until nothing is left or the supervisor is gone; ends as a command does."""
    crew.obey()
    run(lambda _: _work(orders))


def _work(orders: Orders) -> None:
    # This worker's share of the cores.
    tf.config.threading.set_intra_op_parallelism_threads(orders.threads)
    tf.config.threading.set_inter_op_parallelism_threads(orders.threads)
    trainer = Trainer(orders.budget, Pictures(orders.budget, threads=orders.threads))
    book = _opened(orders)
    work(book, Training(trainer, book, orders.folder), wanted=lambda: not crew.orphaned())


def _opened(orders: Orders) -> Book:
    """The study's book. The command has opened it before: where that fails now the database is away."""
    begun = time.monotonic()
    while True:
        try:
            return orders.open()
        except InputError:
            if time.monotonic() - begun > orders.rules.patience_s:
                raise
            time.sleep(_PAUSE_S)
