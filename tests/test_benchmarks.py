"""Benchmarks: how speed and memory are measured, not the figures."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, only

from laesi_tf import benchmark
from laesi_tf.benchmarks import component_cost, photo_speed, synthesis_report, training_speed
from laesi_tf.benchmarks.timing import MedianIqr
from laesi_tf.common import hardware
from laesi_tf.common.errors import InputError
from laesi_tf.estimators.base import Measurement
from laesi_tf.synthesis import COMPONENTS

SIZE = (32, 32)
KEYS = {"images_per_s", "live_over_cached_small", "live_over_cached_large", "component_us", "peak_rss_mb"}


class Clock:
    """A clock that tests move."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_spread_is_median_and_quartiles() -> None:
    spread = MedianIqr.of([5.0, 1.0, 2.0, 100.0, 3.0])
    assert (spread.median, spread.iqr) == (3.0, 3.0) and spread.is_noise
    assert not MedianIqr.of([5.0, 5.5, 6.0]).is_noise


def test_turns_time_the_steps_and_not_the_settling(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(training_speed.time, "perf_counter", clock)

    def source(name: str) -> Iterator[str]:
        while True:
            yield name

    rates: dict[str, list[float]] = {"cached": [], "live": []}
    sources = {name: source(name) for name in rates}
    taken = []
    for name in training_speed._alternate_sources(sources, rates, 3, 5):
        taken.append(name)
        settling = (len(taken) - 1) % (training_speed.WARMUP_STEPS + 5) < training_speed.WARMUP_STEPS
        clock.now += 1000.0 if settling else {"cached": 0.1, "live": 0.2}[name]
    turn = training_speed.WARMUP_STEPS + 5
    assert taken[:-1] == (["cached"] * turn + ["live"] * turn) * 3
    assert rates["cached"] == pytest.approx([320.0] * 3) and rates["live"] == pytest.approx([160.0] * 3)


def test_training_is_fed_from_memory_and_live_in_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    fed = []

    def fit(config: Any, out: Path, *, train: Any, validation: Any) -> Any:
        stream = iter(train(0))
        for _ in range(config.steps):
            images, _ = next(stream)
            fed.append(images.numpy().tobytes())
        assert len(list(train(0))) == training_speed.CACHED_BATCHES and len(validation) == 1
        return type("Result", (), {"metrics": {"weights_origin": config.weights}})

    monkeypatch.setattr(training_speed, "fit", fit)
    found = training_speed.measure_training_speed(
        "small", only("ruling"), weights="none", repeats=2, steps=3, seed=0, size=SIZE
    )
    turn = training_speed.WARMUP_STEPS + 3
    cached, live = set(fed[:turn]) | set(fed[2 * turn : 3 * turn]), fed[turn : 2 * turn] + fed[3 * turn :]
    assert (
        len(cached) == training_speed.CACHED_BATCHES
        and len(set(live)) == len(live)
        and not cached & set(live)
    )
    assert found["weights_origin"] == "none"
    assert found["ratio"] == pytest.approx(found["live"].median / found["cached"].median)


def test_a_components_cost_is_what_goes_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(component_cost.time, "process_time", clock)
    price = {"ruling": 300e-6, "spots": 20e-6}

    def maker(ranges: Any, *, seed: int, size: Any) -> Any:
        def make(index: tf.Tensor) -> None:
            # A machine that slows down: the differences must not see it.
            clock.now += 1e-3 + 1e-6 * int(index) + sum(cost for n, cost in price.items() if ranges.has(n))

        return make

    monkeypatch.setattr(component_cost, "trace_renderer", maker)
    found = component_cost.measure_component_cost(only(*price), repeats=2, seed=0, size=SIZE, images=4)
    assert {name: spread.median for name, spread in found.items()} == pytest.approx(
        {"ruling": 300, "spots": 20}
    )


def test_cpu_time_of_each_way_stays_with_it() -> None:
    calls: list[int] = []
    makers = [lambda index, n=n: calls.append(n) for n in range(3)]
    assert len(component_cost._measure_cpu_us(makers, 0)) == 3 and calls == [0, 1, 2]
    component_cost._measure_cpu_us(makers, 1)
    assert calls[3:] == [1, 2, 0]


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="needs Linux's own account of it")
def test_peak_memory_is_what_the_system_says() -> None:
    lines = Path("/proc/self/status").read_text().splitlines()
    (kilobytes,) = (int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    assert hardware.peak_rss_mb() == pytest.approx(kilobytes * 1024 / 1e6, rel=0.02)


def test_report_and_json(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rates = {"cached": MedianIqr(200.0, 4.0), "live": MedianIqr(190.0, 5.0), "ratio": 0.95}
    monkeypatch.setattr(
        synthesis_report, "measure_training_speed", lambda *_, **__: rates | {"weights_origin": "none"}
    )
    path, ranges = tmp_path / "figures.json", tmp_path / "simple.toml"
    ranges.write_text(f"without = {[name for name in COMPONENTS if name != 'ruling']}\n")
    arguments = ["--ranges", str(ranges), "--size", "32", "--images", "70", "--repeats", "1"]
    benchmark.main(["synthesis", *arguments, "--json", str(path)])
    figures, printed = json.loads(path.read_text()), capsys.readouterr().out
    assert set(figures) >= KEYS and list(figures["component_us"]) == ["ruling"]
    alone = ("", "every_component_", "one_light_", "one_light_every_component_")
    assert all(figures[f"{sort}images_per_s"] > 0 for sort in alone)
    assert figures["lighting_passes"] == RENDERING_2.lighting_passes
    assert figures["live_over_cached_small"] == figures["live_over_cached_large"] == 0.95
    assert figures["memory_images"] == 70 and figures["peak_rss_mb"] >= figures["settled_rss_mb"] > 100
    for text in ("ruling, CPU", "training small, live over cached", "0.950", "peak memory, 70 images"):
        assert text in printed


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["speed"],
        ["synthesis", "--images", "0"],
        ["synthesis", "--repeats", "many"],
        ["synthesis", "--ranges", "rendering_9"],
        ["synthesis", "--json", "."],
    ],
)
def test_bad_input(arguments: list[str]) -> None:
    with pytest.raises(InputError):
        benchmark.main(arguments)


class Slow:
    """An estimator that takes a given time by a clock, a long one for its first photo."""

    def __init__(self, clock: Clock) -> None:
        self.clock, self.sizes = clock, []

    def measure(self, image: np.ndarray, known: Any = None) -> Measurement:
        self.clock.now += 0.03 if self.sizes else 5.0
        self.sizes.append(image.shape)
        return Measurement(method="slow")


def test_photos_are_measured_at_their_size_and_the_first_does_not_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    monkeypatch.setattr(photo_speed.time, "perf_counter", clock)
    estimator = Slow(clock)
    # A further size of scenes would take 0.7 GB to compile.
    grey = {"image": tf.zeros((48, 64, 3), tf.uint8)}
    monkeypatch.setattr(photo_speed, "trace_renderer", lambda *_, **__: lambda _: grey)
    figures = photo_speed.time_photos(estimator, seed=0, size=(48, 64), repeats=3)
    assert estimator.sizes == [(48, 64, 3)] * 4
    assert figures["measure_ms"] == pytest.approx(30) and figures["decode_ms"] == 0
    assert figures["methods"] == ["slow"] and figures["photos"] == 3
    assert photo_speed._scene_size((3000, 4000)) == (1200, 1600)


def test_starts_are_timed_in_processes_of_their_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = tmp_path / "start.json"
    sample = Path(__file__).parents[1] / "docs/sample/leaf.jpg"
    benchmark.main(["start", str(sample), "--repeats", "1", "--json", str(figures)])
    metrics = json.loads(figures.read_text(encoding="utf-8"))
    assert 0 < metrics["first_area_s"] <= metrics["whole_s"]
    assert 0 < metrics["peak_mb"] == metrics["largest_peak_mb"]
    assert "start of the process to first area" in capsys.readouterr().out
