"""Pictures made on other machines, through TensorFlow's own tf.data service.

A batch is the unit of work: whichever worker is free takes the next one, so batches come back in any order.
They are handed on in their own, so that what a model is fed, and what a run continues with after a kill, is
the same as without the service. The service gives each batch to one worker and forgets those of a worker that
dies: such a gap is filled here.
"""

import socket
from collections.abc import Callable, Iterator
from typing import Any

import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.data.synthetic import TRAIN_INDICES

Batch = tuple[tf.Tensor, Any]
MakeExamples = Callable[[tf.data.Dataset], tf.data.Dataset]
"""From the places of pictures in a stream, int64 [], whole batches of them, to (place, (image, target)), in
the same order."""

_MAX_EARLY_BATCHES = 24
"""Batches that may overtake one before it counts as lost: more than workers have in hand between them."""
_CONNECT_TIMEOUT_S = 5.0


def receive_batches(make: MakeExamples, address: str, *, batch_size: int, start: int) -> Iterator[Batch]:
    """Batches from the dispatcher at `address` (HOST:PORT) of the stream that `make` makes, without end.

    The first picture is `start`, a multiple of `batch_size`. Raises InputError where nobody answers.
    """
    check_reachable(address)
    blocks = tf.data.Dataset.range(start // batch_size, TRAIN_INDICES[1] // batch_size)
    spread = tf.data.experimental.service.distribute(
        processing_mode=tf.data.experimental.service.ShardingPolicy.DYNAMIC,
        service=f"grpc://{address}",
        compression=None,  # sensor noise does not compress
    )
    numbered = _number_batches(make, blocks, batch_size).apply(spread)
    return reorder_batches(
        ((int(block), batch) for block, batch in numbered),
        start // batch_size,
        lambda block: _render_lost_batch(make, block, batch_size),
    )


def reorder_batches(
    arriving: Iterator[tuple[int, Batch]], first: int, fill: Callable[[int], Batch]
) -> Iterator[Batch]:
    """The batches of `arriving` (number, batch) by number, from `first`; those that are lost by `fill`."""
    waiting: dict[int, Batch] = {}
    for number, batch in arriving:
        if number >= first:  # what was given up and comes after all is too late
            waiting[number] = batch
        while first in waiting or len(waiting) > _MAX_EARLY_BATCHES:
            yield waiting.pop(first) if first in waiting else fill(first)
            first += 1


def _number_batches(make: MakeExamples, blocks: tf.data.Dataset, batch_size: int) -> tf.data.Dataset:
    """(number, (image [B, H, W, 3], target)) of each of `blocks`."""

    def places(block: tf.Tensor) -> tf.data.Dataset:
        return tf.data.Dataset.range(block * batch_size, (block + 1) * batch_size)

    examples = make(blocks.flat_map(places)).batch(batch_size)
    return examples.map(lambda place, batch: (place[0] // batch_size, batch))


def _render_lost_batch(make: MakeExamples, block: int, batch_size: int) -> Batch:
    _, batch = next(iter(_number_batches(make, tf.data.Dataset.range(block, block + 1), batch_size)))
    return batch


def check_reachable(address: str) -> None:
    host, separator, port = address.rpartition(":")
    if not separator or not port.isdigit():
        raise InputError(f"data service {address!r} is not HOST:PORT")
    try:
        socket.create_connection((host, int(port)), timeout=_CONNECT_TIMEOUT_S).close()
    except OSError as error:
        raise InputError(
            f"no data service answers at {address} ({error}); start one with python -m laesi_tf.serve"
        ) from error
