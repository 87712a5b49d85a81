"""How fast pictures are made, alone and under training, what each component takes, and memory."""

import argparse
import dataclasses
import itertools
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli import parser, positive, progress, size
from laesi_tf.synthesis import COMPONENTS, Ranges, load_ranges
from laesi_tf.synthesis.presets import enable_all_components

# isort: split
import numpy as np
import tensorflow as tf

from laesi_tf.benchmarks.spread import Spread, line
from laesi_tf.config import TrainConfig
from laesi_tf.data import synthetic
from laesi_tf.files import require_writable, write_json
from laesi_tf.machine import described, peak_rss_mb
from laesi_tf.synthesis import synthesise
from laesi_tf.training import fit

Size = tuple[int, int]

_BATCH = 32
_CACHED_BATCHES = 8
_SETTLING_STEPS = 6
"""Untimed steps after a turn begins: the stream before may still be filling its buffers."""
_SORTS = {
    "images_per_s": "synthesis",
    "every_component_images_per_s": "every component",
    "one_light_images_per_s": "one light",
    "one_light_every_component_images_per_s": "one light, every component",
}
"""Sorts of pictures that are made alone: the key of their figure and its name in the table."""
_SETTLED_IMAGES = 2000
"""Pictures after which memory should have stopped growing."""


def main(arguments: Sequence[str]) -> None:
    """Speed of synthesis, alone, per component and under training; its peak memory."""
    options = _options().parse_args(arguments)
    if options.json is not None:
        require_writable(options.json)
    plain = load_ranges(options.ranges)
    if options.lighting_passes is not None:
        plain = plain.with_passes(options.lighting_passes)
    every = enable_all_components(plain)
    made = plain, every, plain.with_passes(1), every.with_passes(1)
    sorts = dict(zip(_SORTS, made, strict=True))
    scene = {"seed": options.seed, "size": options.size}
    # First, while nothing else is in memory.
    memory = peak_memory_mb(plain, images=options.images, **scene)
    alone = images_per_s(sorts, repeats=options.repeats, **scene)
    parts = component_us(every.with_passes(1), repeats=options.repeats, **scene)
    loops = {"weights": options.weights, "repeats": options.repeats, "steps": options.steps}
    trained = {kind: training_rates(kind, plain, **loops, **scene) for kind in ("small", "large")}
    figures = _figures(memory, alone, parts, trained) | {"lighting_passes": plain.lighting_passes}
    if options.json is not None:
        write_json(options.json, figures)
    print(_table(figures))


def peak_memory_mb(ranges: Ranges, *, images: int, seed: int, size: Size) -> dict[str, float]:
    """Peak resident memory of this process over `images` pictures, and after the first 2,000 of them.

    The peak never falls, so a leak shows as the difference.
    """
    source = _stream(ranges, seed, size, count=images)
    settled = None
    made = 0
    for pictures, _ in progress(source, total=-(-images // _BATCH), desc="memory", unit="batch"):
        made += len(pictures)
        if settled is None and made >= min(_SETTLED_IMAGES, images):
            settled = peak_rss_mb()
    return {"peak": peak_rss_mb(), "settled": settled or peak_rss_mb(), "images": made}


def images_per_s(
    sorts: dict[str, Ranges], *, repeats: int, seed: int, size: Size, batches: int = 16
) -> dict[str, Spread]:
    """Pictures per second of the generator for each of `sorts`, nothing else running."""
    streams = {name: iter(_stream(ranges, seed, size)) for name, ranges in sorts.items()}
    rates: dict[str, list[float]] = {name: [] for name in sorts}
    for _ in progress(range(repeats), desc="synthesis alone", unit="turn"):
        for name, stream in streams.items():
            _exhaust(itertools.islice(stream, _SETTLING_STEPS))
            begun = time.perf_counter()
            _exhaust(itertools.islice(stream, batches))
            rates[name].append(batches * _BATCH / (time.perf_counter() - begun))
    return {name: Spread.of(values) for name, values in rates.items()}


def component_us(
    every: Ranges, *, repeats: int, seed: int, size: Size, images: int = 48
) -> dict[str, Spread]:
    """CPU microseconds per picture that each component takes: all components less all but this one.

    `every` has all components in every picture. The time is that of all threads of this process, so what
    else the machine does counts little. Each picture is made in all ways one after the other, since the
    differences are smaller than a processor's drift over a second; a turn's figure is the median of `images`.
    """
    names = [name for name in COMPONENTS if every.has(name)]
    kinds = [every, *(dataclasses.replace(every, without=every.without | {name}) for name in names)]
    makers = [_maker(ranges, seed, size) for ranges in progress(kinds, desc="tracing", unit="component")]
    medians = []
    for turn in progress(range(repeats), desc="components", unit="turn"):
        spent = np.array([_cpu_us(makers, index) for index in range(turn * images, (turn + 1) * images)])
        medians.append(np.median(spent[:, :1] - spent[:, 1:], axis=0))
    return {name: Spread.of(costs) for name, costs in zip(names, np.transpose(medians), strict=True)}


def training_rates(
    backbone: str, ranges: Ranges, *, weights: str, repeats: int, steps: int, seed: int, size: Size
) -> dict[str, Any]:
    """Images per second of the training loop on pictures cached in memory and on live ones, in turns.

    Returns Spreads `cached` and `live`, and `ratio`, live over cached (of medians).
    """
    cached = list(_stream(ranges, seed, size, count=_CACHED_BATCHES * _BATCH))
    live = _stream(ranges, seed, size, start=_CACHED_BATCHES * _BATCH)
    rates: dict[str, list[float]] = {"cached": [], "live": []}
    turns = {"cached": itertools.cycle(cached), "live": iter(live)}
    # The loop asks for its stream once more when it calibrates batch normalisation after the last step.
    streams = iter([_timed_turns(turns, rates, repeats, steps), cached])
    config = TrainConfig(
        backbone=backbone,
        size=size,
        batch_size=_BATCH,
        weights=weights,
        seed=seed,
        steps=2 * repeats * (_SETTLING_STEPS + steps) + 1,
        validate_every=10**9,
        checkpoint_every=10**9,
    )
    with tempfile.TemporaryDirectory() as folder:
        result = fit(config, Path(folder), train=lambda _: next(streams), validation=cached[:1])
    spreads = {name: Spread.of(values) for name, values in rates.items()}
    ratio = spreads["live"].median / spreads["cached"].median
    return {**spreads, "ratio": ratio, "weights_origin": result.metrics["weights_origin"]}


def _timed_turns(
    sources: dict[str, Iterator[Any]], rates: dict[str, list[float]], repeats: int, steps: int
) -> Iterator[Any]:
    """Batches of each source in turn; how fast they were asked for goes into `rates`.

    From one batch being handed out to the next being asked for, the loop trains on it; getting a batch is
    timed as well.
    """
    for _ in range(repeats):
        for name, source in sources.items():
            yield from itertools.islice(source, _SETTLING_STEPS)
            begun = time.perf_counter()
            yield from itertools.islice(source, steps)
            rates[name].append(steps * _BATCH / (time.perf_counter() - begun))
    yield next(source)


def _stream(
    ranges: Ranges, seed: int, size: Size, *, start: int = 0, count: int | None = None
) -> tf.data.Dataset:
    """Batches (image, area_cm2) as training gets them."""
    return synthetic.batches(
        task="area", batch_size=_BATCH, seed=seed, size=size, ranges=ranges, start=start, count=count
    )


def _maker(ranges: Ranges, seed: int, size: Size) -> Callable[[tf.Tensor], dict[str, tf.Tensor]]:
    """A graph from an index to its picture, ready to be timed."""
    traced = tf.function(lambda index: synthesise(seed, size=size, ranges=ranges, index=index))
    made = traced.get_concrete_function(tf.TensorSpec([], tf.int64))
    made(tf.constant(0, tf.int64))  # the first call optimises the graph
    return made


def _cpu_us(makers: Sequence[Callable[[tf.Tensor], Any]], index: int) -> list[float]:
    """CPU time of picture `index` with each of `makers`, in an order that moves on with the index."""
    picture = tf.constant(index, tf.int64)
    spent = [0.0] * len(makers)
    for place in range(len(makers)):
        chosen = (place + index) % len(makers)
        begun = time.process_time()
        makers[chosen](picture)
        spent[chosen] = (time.process_time() - begun) * 1e6
    return spent


def _exhaust(items: Iterator[Any]) -> None:
    for _ in items:
        pass


def _figures(
    memory: dict[str, float],
    alone: dict[str, Spread],
    parts: dict[str, Spread],
    trained: dict[str, dict[str, Any]],
) -> dict[str, Any]:
    return {
        **{name: rate.median for name, rate in alone.items()},
        **{f"{name}_iqr": rate.iqr for name, rate in alone.items()},
        "live_over_cached_small": trained["small"]["ratio"],
        "live_over_cached_large": trained["large"]["ratio"],
        "component_us": {name: part.median for name, part in parts.items()},
        "peak_rss_mb": memory["peak"],
        "settled_rss_mb": memory["settled"],
        "memory_images": memory["images"],
        "component_us_iqr": {name: part.iqr for name, part in parts.items()},
        "component_is_noise": {name: part.is_noise for name, part in parts.items()},
        "training_images_per_s": {
            kind: {name: rates[name].median for name in ("cached", "live")} for kind, rates in trained.items()
        },
        "training_images_per_s_iqr": {
            kind: {name: rates[name].iqr for name in ("cached", "live")} for kind, rates in trained.items()
        },
        "weights_origin": {kind: rates["weights_origin"] for kind, rates in trained.items()},
        **described(),
    }


def _table(figures: dict[str, Any]) -> str:
    """The figures for people: name, median, interquartile range."""
    lines = [line("", "median", "IQR"), *_rate_lines(figures)]
    for name, cost in figures["component_us"].items():
        noise = "  noise" if figures["component_is_noise"][name] else ""
        iqr = f"{figures['component_us_iqr'][name]:.0f}"
        lines.append(line(f"{name}, CPU µs per picture", f"{cost:.0f}", iqr) + noise)
    settled = min(_SETTLED_IMAGES, figures["memory_images"])
    return "\n".join(
        [
            *lines,
            line(f"peak memory, {settled} pictures, MB", f"{figures['settled_rss_mb']:.0f}"),
            line(f"peak memory, {figures['memory_images']} pictures, MB", f"{figures['peak_rss_mb']:.0f}"),
            "{lighting_passes} lighting passes over a leaf".format_map(figures),
            "{machine}, {cores} cores, TensorFlow {tensorflow}, {date}".format_map(figures),
        ]
    )


def _rate_lines(figures: dict[str, Any]) -> Iterator[str]:
    for name, what in _SORTS.items():
        yield line(f"{what}, pictures/s", f"{figures[name]:.1f}", f"{figures[f'{name}_iqr']:.1f}")
    for kind, rates in figures["training_images_per_s"].items():
        for name, rate in rates.items():
            iqr = figures["training_images_per_s_iqr"][kind][name]
            yield line(f"training {kind}, {name}, pictures/s", f"{rate:.1f}", f"{iqr:.1f}")
        yield line(f"training {kind}, live over cached", f"{figures[f'live_over_cached_{kind}']:.3f}")


def _options() -> argparse.ArgumentParser:
    made = parser("benchmark synthesis", main.__doc__)
    made.add_argument("--seed", type=int, default=0, help="seed of the scenes")
    made.add_argument(
        "--size", type=size, default=(224, 224), metavar="PX", help="SIDE or HEIGHTxWIDTH in pixels"
    )
    made.add_argument("--ranges", default="rendering_2", metavar="PRESET|FILE", help="where scenes come from")
    made.add_argument(
        "--lighting-passes",
        type=positive,
        metavar="N",
        help="pictures of the same leaf in different light; default: as the ranges say. train makes one",
    )
    made.add_argument("--images", type=positive, default=20000, metavar="N", help="pictures for the memory")
    made.add_argument(
        "--repeats", type=positive, default=5, metavar="N", help="turns of each part; one has no range"
    )
    made.add_argument("--steps", type=positive, default=20, metavar="N", help="timed steps per turn")
    made.add_argument(
        "--weights",
        choices=("auto", "imagenet", "none"),
        default="auto",
        help="the networks' weights, as for train; batch normalisation costs less where they are pretrained",
    )
    return made
