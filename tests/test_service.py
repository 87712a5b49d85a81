"""Pictures made by other processes: the same batches in the same order, each once, whatever happens."""

import itertools
import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given
from hypothesis import strategies as st
from scenes import only

from laesi_tf.common.errors import InputError
from laesi_tf.data import tf_data_service
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.input_pipeline import make_training_stream
from laesi_tf.training.loop import fit

CONFIG = TrainConfig(
    size=(32, 32), batch_size=4, steps=2, weights="none", augment="flip", validation_pictures=4
)


@st.composite
def arrivals(draw: st.DrawFn) -> tuple[list[int], int]:
    """Numbers from `first` on in an order that workers could finish them in, some lost."""
    first, count = draw(st.integers(0, 5)), draw(st.integers(1, 40))
    numbers = [number for number in range(first, first + count) if draw(st.integers(0, 9))]
    late = {number: number + draw(st.integers(0, 6)) for number in numbers}
    # What comes after all that, so that what was lost is missed.
    return sorted(numbers, key=lambda number: late[number]) + list(
        range(first + count, first + count + 60)
    ), first


def test_what_comes_after_its_gap_was_filled_is_dropped() -> None:
    lost, count = range(0, 200, 8), 200
    overtaken = [number for number in range(count) if number not in lost]
    # Each of them late by more than patience has.
    late = sorted([*overtaken, *lost], key=lambda number: number + 60 * (number in lost))
    filled: list[int] = []
    found = list(tf_data_service.reorder_batches(((n, n) for n in late), 0, lambda n: filled.append(n) or n))
    assert found == list(range(len(found)))
    assert set(filled) <= set(lost)


@given(arrivals())
def test_batches_are_put_in_order_and_gaps_filled(case: tuple[list[int], int]) -> None:
    numbers, first = case
    filled = []

    def fill(number: int) -> str:
        filled.append(number)
        return f"batch {number}"

    arriving = ((number, f"batch {number}") for number in numbers)
    found = list(tf_data_service.reorder_batches(arriving, first, fill))
    assert found == [f"batch {number}" for number in range(first, first + len(found))]
    assert set(filled) == set(range(first, first + len(found))) - set(numbers)
    assert len(found) == numbers[-1] + 1 - first


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Two processes that serve, one with the dispatcher; and the address."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        address = f"localhost:{free.getsockname()[1]}"
    told = tmp_path / "serving.json"
    commands = [["--port", address.rpartition(":")[2], "--json", str(told)], ["--join", address]]
    started = [
        subprocess.Popen(
            [sys.executable, "-m", "laesi_tf.serve", *command], stdout=subprocess.PIPE, text=True
        )
        for command in commands
    ]
    for process in started:
        assert process.stdout is not None and address in process.stdout.readline()
    assert json.loads(told.read_text()) == {"data_service": address}
    yield address, started
    for process in started:
        process.kill()
        process.wait()


def test_the_stream_is_that_of_one_machine_whatever_becomes_of_a_worker(machines, tmp_path: Path) -> None:
    address, (_, joined) = machines
    ranges = tmp_path / "simple.toml"
    ranges.write_text(f"without = {sorted(only('ruling', 'sensor_noise').without)}\n")
    config = replace(CONFIG, ranges=str(ranges), lighting_passes=2)
    pairs = zip(make_training_stream(config, "")(8), make_training_stream(config, address)(8), strict=False)
    for number, (expected, found) in enumerate(itertools.islice(pairs, 120)):
        if number == 40:
            joined.kill()
        assert_same(expected, found)


def assert_same(expected: tf_data_service.Batch, found: tf_data_service.Batch) -> None:
    for one, other in zip(tf.nest.flatten(expected), tf.nest.flatten(found), strict=True):
        np.testing.assert_array_equal(one, other)


def test_where_nobody_serves_is_said_at_once(tmp_path: Path) -> None:
    begun = time.monotonic()
    with pytest.raises(InputError, match=r"no data service answers at localhost:1 .*laesi_tf\.serve"):
        fit(CONFIG, tmp_path / "run", data_service="localhost:1", show_progress=False)
    assert time.monotonic() - begun < 60
    with pytest.raises(InputError, match="HOST:PORT"):
        tf_data_service.receive_batches(lambda places: places, "somewhere", batch_size=2, start=0)


def test_a_mixture_is_not_made_elsewhere_nor_lit_several_times(tmp_path: Path) -> None:
    mixture = tmp_path / "mixture.toml"
    mixture.write_text('[only]\nkind = "live"\nweight = 1.0\n')
    mixed = replace(CONFIG, mixture=str(mixture))
    with pytest.raises(InputError, match="--data-service or --mixture"):
        fit(mixed, tmp_path / "run", data_service="localhost:1", show_progress=False)
    with pytest.raises(InputError, match="--lighting-passes or --mixture"):
        fit(replace(mixed, lighting_passes=2), tmp_path / "lit", show_progress=False)
