"""Batches from other processes: the same ones in the same order, each once, also after a failure."""

import itertools
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given
from hypothesis import strategies as st
from scenes import only

from laesi_tf import serve
from laesi_tf.common import network
from laesi_tf.common.errors import InputError
from laesi_tf.data import tf_data_service
from laesi_tf.data.batch_part import BatchPart
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.input_pipeline import InputPipeline
from laesi_tf.training.loop import fit
from laesi_tf.training.replicas import Replicas

CONFIG = TrainConfig(
    size=(32, 32), batch_size=4, steps=2, weights="none", augment="flip", validation_pictures=4
)


@st.composite
def arrivals(draw: st.DrawFn) -> tuple[list[int], int]:
    """Numbers from `first` on in an order in which workers could finish them, some lost."""
    first, count = draw(st.integers(0, 5)), draw(st.integers(1, 40))
    numbers = [number for number in range(first, first + count) if draw(st.integers(0, 9))]
    late = {number: number + draw(st.integers(0, 6)) for number in numbers}
    # Later batches, so that the lost ones are missed.
    return sorted(numbers, key=lambda number: late[number]) + list(
        range(first + count, first + count + 60)
    ), first


def test_a_batch_that_arrives_after_its_gap_was_filled_is_dropped() -> None:
    lost, count = range(0, 200, 8), 200
    overtaken = [number for number in range(count) if number not in lost]
    # Each of them late by more than patience has.
    late = sorted([*overtaken, *lost], key=lambda number: number + 60 * (number in lost))
    filled: list[int] = []
    received = list(
        tf_data_service.reorder_batches(((n, n) for n in late), 0, lambda n: filled.append(n) or n)
    )
    assert received == list(range(len(received)))
    assert set(filled) <= set(lost)


@given(arrivals())
def test_batches_are_reordered_and_gaps_rendered(case: tuple[list[int], int]) -> None:
    numbers, first = case
    filled = []

    def fill(number: int) -> str:
        filled.append(number)
        return f"batch {number}"

    arriving = ((number, f"batch {number}") for number in numbers)
    received = list(tf_data_service.reorder_batches(arriving, first, fill))
    assert received == [f"batch {number}" for number in range(first, first + len(received))]
    assert set(filled) == set(range(first, first + len(received))) - set(numbers)
    assert len(received) == numbers[-1] + 1 - first


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Two processes that serve, one with the dispatcher; and the address."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        address = f"localhost:{free.getsockname()[1]}"
    report = tmp_path / "serving.json"
    commands = [["--port", address.rpartition(":")[2], "--json", str(report)], ["--join", address]]
    started = [
        subprocess.Popen(
            [sys.executable, "-m", "laesi_tf.serve", "--trust-network", *command],
            stdout=subprocess.PIPE,
            text=True,
        )
        for command in commands
    ]
    for process in started:
        assert process.stdout is not None and address in process.stdout.readline()
    assert json.loads(report.read_text()) == {"data_service": address}
    yield address, started
    for process in started:
        process.kill()
        process.wait()


def test_the_stream_equals_that_of_one_machine_also_if_a_worker_dies(machines, tmp_path: Path) -> None:
    address, (_, joined) = machines
    ranges = tmp_path / "simple.toml"
    ranges.write_text(f"without = {sorted(only('ruling', 'sensor_noise').without)}\n")
    config = replace(CONFIG, ranges=str(ranges), lighting_passes=2)
    pairs = zip(
        InputPipeline(config).training_batches(8),
        InputPipeline(config, data_service=address).training_batches(8),
        strict=False,
    )
    for number, (expected, received) in enumerate(itertools.islice(pairs, 120)):
        if number == 40:
            joined.kill()
        assert_same(expected, received)
    part = Replicas(part=BatchPart(1, 2))  # of a training in two processes
    second_half = InputPipeline(config, data_service=address, replicas=part).training_batches(8)
    whole = InputPipeline(config).training_batches(8)
    for expected, received in itertools.islice(zip(whole, second_half, strict=False), 3):
        assert_same(tf.nest.map_structure(lambda values: values[2:], expected), received)


def assert_same(expected: tf_data_service.Batch, received: tf_data_service.Batch) -> None:
    for one, other in zip(tf.nest.flatten(expected), tf.nest.flatten(received), strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_address_without_a_service_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no data service answers at localhost:1 .*laesi_tf\.serve"):
        fit(CONFIG, tmp_path / "run", data_service="localhost:1", show_progress=False)
    with pytest.raises(InputError, match="HOST:PORT"):
        tf_data_service.receive_batches(lambda places: places, "somewhere", batch_size=2, start=0)


def test_a_mixture_takes_neither_a_data_service_nor_lighting_passes(tmp_path: Path) -> None:
    mixture = tmp_path / "mixture.toml"
    mixture.write_text('[only]\nkind = "live"\nweight = 1.0\n')
    mixed = replace(CONFIG, mixture=str(mixture))
    with pytest.raises(InputError, match="--data-service or --mixture"):
        fit(mixed, tmp_path / "run", data_service="localhost:1", show_progress=False)
    with pytest.raises(InputError, match="--lighting-passes or --mixture"):
        fit(replace(mixed, lighting_passes=2), tmp_path / "lit", show_progress=False)


@pytest.mark.parametrize("address", ["somewhere", "localhost", "localhost:", ":5050", "host:99999", "host:x"])
def test_malformed_addresses_are_refused_before_anything_is_written(tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match="HOST:PORT"):
        fit(CONFIG, tmp_path / "run", data_service=address, show_progress=False)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--trust-network"),
        (["--trust-network", "--port", "99999"], "not a port from 1 to 65535"),
        (["--trust-network", "--port", "0"], "not a port from 1 to 65535"),
        (["--trust-network", "--join", "nohost"], "HOST:PORT"),
        (["--trust-network", "--join", "no.such.host.invalid:5050"], "no data service answers"),
    ],
)
def test_serve_refuses_what_it_cannot_serve(arguments: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        serve.main(arguments)


def test_a_worker_waits_a_limited_time_for_its_dispatcher() -> None:
    with pytest.raises(InputError, match="no data service answers at localhost:1"):
        network.wait_until_reachable("localhost:1", timeout_s=0.1)
