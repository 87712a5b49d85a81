"""Receive batches that other machines render, through TensorFlow's own tf.data service.

A batch is the unit of work: the next free worker renders the next one, so batches arrive in any order. They
are put back in their own order, so that a network gets the same batches as without the service, also when a
run continues after a kill. The service gives each batch to one worker and loses those of a worker that dies:
such a gap is rendered here.
"""

from collections.abc import Callable, Iterator
from typing import Any

import tensorflow as tf

from laesi_tf.common.network import check_reachable
from laesi_tf.data.batch_part import WHOLE_BATCH, BatchPart
from laesi_tf.data.synthetic import TRAIN_INDICES

Batch = tuple[tf.Tensor, Any]
MakeExamples = Callable[[tf.data.Dataset], tf.data.Dataset]
"""From indices of samples, int64 [], in complete batches, to (index, (image, target)) in order."""

_MAX_EARLY_BATCHES = 24
"""Number of later batches after which a batch is lost: more than all workers render at once."""


def receive_batches(
    make_examples: MakeExamples, address: str, *, batch_size: int, start: int, part: BatchPart = WHOLE_BATCH
) -> Iterator[Batch]:
    """Receive the endless stream of batches of `make_examples` from the dispatcher at `address` (HOST:PORT).

    The first sample is `start`, a multiple of `batch_size`; only `part` of each batch is made. Raises
    InputError if nothing listens there.
    """
    check_reachable(address)
    numbers = tf.data.Dataset.range(start // batch_size, TRAIN_INDICES[1] // batch_size)
    distribute = tf.data.experimental.service.distribute(
        processing_mode=tf.data.experimental.service.ShardingPolicy.DYNAMIC,
        service=f"grpc://{address}",
        compression=None,  # sensor noise does not compress
    )
    batches = _number_batches(make_examples, numbers, batch_size, part).apply(distribute)
    return reorder_batches(
        ((int(number), batch) for number, batch in batches),
        start // batch_size,
        lambda number: _render_lost_batch(make_examples, number, batch_size, part),
    )


def reorder_batches(
    arriving: Iterator[tuple[int, Batch]], first: int, render_lost: Callable[[int], Batch]
) -> Iterator[Batch]:
    """Yield the batches of `arriving` (number, batch) in order from `first` on; render lost ones."""
    early: dict[int, Batch] = {}
    for number, batch in arriving:
        if number >= first:  # a batch whose gap was filled may still arrive
            early[number] = batch
        while first in early or len(early) > _MAX_EARLY_BATCHES:
            yield early.pop(first) if first in early else render_lost(first)
            first += 1


def _number_batches(
    make_examples: MakeExamples, numbers: tf.data.Dataset, batch_size: int, part: BatchPart
) -> tf.data.Dataset:
    """Make `part` of the batches `numbers`: (number, (image [B, H, W, 3], target))."""
    size = part.size(batch_size)

    def sample_indices(number: tf.Tensor) -> tf.data.Dataset:
        first = number * batch_size + part.first(batch_size)
        return tf.data.Dataset.range(first, first + size)

    examples = make_examples(numbers.flat_map(sample_indices)).batch(size)
    return examples.map(lambda index, batch: (index[0] // batch_size, batch))


def _render_lost_batch(make_examples: MakeExamples, number: int, batch_size: int, part: BatchPart) -> Batch:
    numbers = tf.data.Dataset.range(number, number + 1)
    _, batch = next(iter(_number_batches(make_examples, numbers, batch_size, part)))
    return batch
