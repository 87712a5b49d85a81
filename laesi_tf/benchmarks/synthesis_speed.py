"""Measure how fast scenes are rendered, alone and during training, the cost of each component, and memory."""

import argparse
import itertools
import time
from collections.abc import Iterator, Sequence
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.hardware import describe_hardware, peak_rss_mb
from laesi_tf.common.parsing import image_size, positive_int
from laesi_tf.common.progress import progress_bar
from laesi_tf.synthesis import Ranges, load_ranges
from laesi_tf.synthesis.presets import enable_all_components

# isort: split
from laesi_tf.benchmarks.component_cost import measure_component_cost
from laesi_tf.benchmarks.timing import (
    BATCH_SIZE,
    WARMUP_STEPS,
    MedianIqr,
    Size,
    consume,
    format_row,
    stream_scenes,
)
from laesi_tf.benchmarks.training_speed import measure_training_speed

VARIANTS = {
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
    options = _make_parser().parse_args(arguments)
    if options.json is not None:
        require_writable(options.json)
    plain = load_ranges(options.ranges)
    if options.lighting_passes is not None:
        plain = plain.with_passes(options.lighting_passes)
    every = enable_all_components(plain)
    made = plain, every, plain.with_passes(1), every.with_passes(1)
    sorts = dict(zip(VARIANTS, made, strict=True))
    scene = {"seed": options.seed, "size": options.size}
    # First, while nothing else is in memory.
    memory = measure_peak_memory(plain, images=options.images, **scene)
    alone = measure_throughput(sorts, repeats=options.repeats, **scene)
    parts = measure_component_cost(every.with_passes(1), repeats=options.repeats, **scene)
    loops = {"weights": options.weights, "repeats": options.repeats, "steps": options.steps}
    trained = {kind: measure_training_speed(kind, plain, **loops, **scene) for kind in ("small", "large")}
    figures = _collect_metrics(memory, alone, parts, trained) | {"lighting_passes": plain.lighting_passes}
    if options.json is not None:
        write_json(options.json, figures)
    print(_format_table(figures))


def measure_peak_memory(ranges: Ranges, *, images: int, seed: int, size: Size) -> dict[str, float]:
    """Peak resident memory of this process over `images` pictures, and after the first 2,000 of them.

    The peak never falls, so a leak shows as the difference.
    """
    source = stream_scenes(ranges, seed, size, count=images)
    settled = None
    made = 0
    for pictures, _ in progress_bar(source, total=-(-images // BATCH_SIZE), desc="memory", unit="batch"):
        made += len(pictures)
        if settled is None and made >= min(_SETTLED_IMAGES, images):
            settled = peak_rss_mb()
    return {"peak": peak_rss_mb(), "settled": settled or peak_rss_mb(), "images": made}


def measure_throughput(
    sorts: dict[str, Ranges], *, repeats: int, seed: int, size: Size, batches: int = 16
) -> dict[str, MedianIqr]:
    """Pictures per second of the generator for each of `sorts`, nothing else running."""
    streams = {name: iter(stream_scenes(ranges, seed, size)) for name, ranges in sorts.items()}
    rates: dict[str, list[float]] = {name: [] for name in sorts}
    for _ in progress_bar(range(repeats), desc="synthesis alone", unit="turn"):
        for name, stream in streams.items():
            consume(itertools.islice(stream, WARMUP_STEPS))
            begun = time.perf_counter()
            consume(itertools.islice(stream, batches))
            rates[name].append(batches * BATCH_SIZE / (time.perf_counter() - begun))
    return {name: MedianIqr.of(values) for name, values in rates.items()}


def _collect_metrics(
    memory: dict[str, float],
    alone: dict[str, MedianIqr],
    parts: dict[str, MedianIqr],
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
        **describe_hardware(),
    }


def _format_table(figures: dict[str, Any]) -> str:
    """The figures for people: name, median, interquartile range."""
    lines = [format_row("", "median", "IQR"), *_format_rates(figures)]
    for name, cost in figures["component_us"].items():
        noise = "  noise" if figures["component_is_noise"][name] else ""
        iqr = f"{figures['component_us_iqr'][name]:.0f}"
        lines.append(format_row(f"{name}, CPU µs per picture", f"{cost:.0f}", iqr) + noise)
    settled = min(_SETTLED_IMAGES, figures["memory_images"])
    return "\n".join(
        [
            *lines,
            format_row(f"peak memory, {settled} pictures, MB", f"{figures['settled_rss_mb']:.0f}"),
            format_row(
                f"peak memory, {figures['memory_images']} pictures, MB", f"{figures['peak_rss_mb']:.0f}"
            ),
            "{lighting_passes} lighting passes over a leaf".format_map(figures),
            "{machine}, {cores} cores, TensorFlow {tensorflow}, {date}".format_map(figures),
        ]
    )


def _format_rates(figures: dict[str, Any]) -> Iterator[str]:
    for name, what in VARIANTS.items():
        yield format_row(f"{what}, pictures/s", f"{figures[name]:.1f}", f"{figures[f'{name}_iqr']:.1f}")
    for kind, rates in figures["training_images_per_s"].items():
        for name, rate in rates.items():
            iqr = figures["training_images_per_s_iqr"][kind][name]
            yield format_row(f"training {kind}, {name}, pictures/s", f"{rate:.1f}", f"{iqr:.1f}")
        yield format_row(f"training {kind}, live over cached", f"{figures[f'live_over_cached_{kind}']:.3f}")


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("benchmark synthesis", main.__doc__)
    made.add_argument("--seed", type=int, default=0, help="seed of the scenes")
    made.add_argument(
        "--size", type=image_size, default=(224, 224), metavar="PX", help="SIDE or HEIGHTxWIDTH in pixels"
    )
    made.add_argument("--ranges", default="rendering_2", metavar="PRESET|FILE", help="where scenes come from")
    made.add_argument(
        "--lighting-passes",
        type=positive_int,
        metavar="N",
        help="pictures of the same leaf in different light; default: as the ranges say. train makes one",
    )
    made.add_argument(
        "--images", type=positive_int, default=20000, metavar="N", help="pictures for the memory"
    )
    made.add_argument(
        "--repeats", type=positive_int, default=5, metavar="N", help="turns of each part; one has no range"
    )
    made.add_argument("--steps", type=positive_int, default=20, metavar="N", help="timed steps per turn")
    made.add_argument(
        "--weights",
        choices=("auto", "imagenet", "none"),
        default="auto",
        help="the networks' weights, as for train; batch normalisation costs less where they are pretrained",
    )
    return made
