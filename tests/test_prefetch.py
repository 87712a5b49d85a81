"""Prefetching keeps the order, bounds memory and continues after a bad file."""

import threading

import pytest

from laesi_tf.common.errors import InputError
from laesi_tf.data.prefetch import prefetch


def halves(number: int) -> int:
    if number % 2:
        raise InputError(f"{number} is odd")
    return number // 2


def test_results_are_in_order_with_errors_in_place() -> None:
    found = list(prefetch(halves, range(7)))
    assert [item for item, _ in found] == list(range(7))
    assert [result for _, result in found[::2]] == [0, 1, 2, 3]
    assert all(isinstance(result, InputError) for _, result in found[1::2])


def test_at_most_depth_items_are_loaded_in_advance() -> None:
    started: list[int] = []
    lock = threading.Lock()

    def read(item: int) -> int:
        with lock:
            started.append(item)
        return item

    results = prefetch(read, range(100), depth=2)
    for expected in range(10):
        assert next(results) == (expected, expected)
        assert len(started) <= expected + 4
    results.close()  # type: ignore[attr-defined]
    assert len(started) < 20


def test_faults_of_ours_are_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        list(prefetch(lambda item: 1 // item, [1, 0, 2]))
