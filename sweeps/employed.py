"""A worker's process, from its start to its end."""

import tensorflow as tf

from laesi_tf.cli import run
from sweeps import crew
from sweeps.objective import Training
from sweeps.orders import Orders
from sweeps.pictures import Pictures
from sweeps.trainer import Trainer
from sweeps.worker import work


def employ(orders: Orders) -> None:
    """Work at the study until nothing is left or the supervisor is gone; ends as a command does."""
    crew.obey()
    run(lambda _: _work(orders))


def _work(orders: Orders) -> None:
    # This worker's share of the cores.
    tf.config.threading.set_intra_op_parallelism_threads(orders.threads)
    tf.config.threading.set_inter_op_parallelism_threads(orders.threads)
    trainer = Trainer(orders.budget, Pictures(orders.budget, threads=orders.threads))
    book = orders.open()
    work(book, Training(trainer, book, orders.folder), wanted=lambda: not crew.orphaned())
