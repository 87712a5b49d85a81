"""Load the next items in threads while the present one is processed."""

import collections
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from laesi_tf.common.errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")


def prefetch(
    read: Callable[[Item], Result], items: Iterable[Item], *, depth: int = 2
) -> Iterator[tuple[Item, Result | InputError]]:
    """Yield (item, read(item)) in order, with up to `depth` further items being read in threads.

    An InputError is yielded in place of the result, so that one bad file does not end the rest; any other
    exception is raised. `depth` bounds the memory: a 12-megapixel photo takes 36 MB.
    """

    def attempt(item: Item) -> tuple[Item, Result | InputError]:
        try:
            return item, read(item)
        except InputError as error:
            return item, error

    waiting: collections.deque[Future[tuple[Item, Result | InputError]]] = collections.deque()
    with ThreadPoolExecutor(max_workers=2) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(attempt, item))
                if len(waiting) > depth:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
