"""The part of every batch that one of several training processes makes."""

from dataclasses import dataclass

import tensorflow as tf


@dataclass(frozen=True)
class BatchPart:
    """Part `index` of `count` equal, contiguous parts of every batch.

    The samples keep their indices, and with them their seeds: all parts together are the batch that one
    process makes. `count` divides the batch size.
    """

    index: int = 0
    count: int = 1

    def size(self, batch_size: int) -> int:
        """Return the number of images of this part."""
        return batch_size // self.count

    def first(self, batch_size: int) -> int:
        """Return the position in its batch of the first image of this part."""
        return self.index * self.size(batch_size)

    def select(self, numbered: tf.data.Dataset, batch_size: int) -> tf.data.Dataset:
        """Return the elements of `numbered`, (index, ...) or index, that belong to this part."""
        if self.count == 1:
            return numbered

        def belongs(index: tf.Tensor, *_: object) -> tf.Tensor:
            return index % batch_size // self.size(batch_size) == self.index

        return numbered.filter(belongs)


WHOLE_BATCH = BatchPart()
