"""Process items in threads, and return the results in the order of the items."""

import collections
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from laesi_tf.common.errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")


def prefetch(
    load: Callable[[Item], Result], items: Iterable[Item], *, depth: int = 2, workers: int = 2
) -> Iterator[tuple[Item, Result | InputError]]:
    """Yield (item, load(item)) in order, while up to `depth` further items are loaded in `workers` threads.

    An InputError takes the place of the result, so that one bad file does not end the loop; any other
    exception is raised. `depth` bounds the memory: a 12-megapixel photo takes 36 MB.
    """

    def try_load(item: Item) -> tuple[Item, Result | InputError]:
        try:
            return item, load(item)
        except InputError as error:
            return item, error

    pending: collections.deque[Future[tuple[Item, Result | InputError]]] = collections.deque()
    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            for item in items:
                pending.append(pool.submit(try_load, item))
                if len(pending) > depth:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
