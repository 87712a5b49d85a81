"""Benchmark `synthesis`: all measurements in order, and their table."""

from collections.abc import Iterator, Mapping
from typing import Any

from laesi_tf.benchmarks.component_cost import measure_component_cost
from laesi_tf.benchmarks.synthesis_speed import SETTLED_IMAGES, measure_peak_memory, measure_throughput
from laesi_tf.benchmarks.timing import MedianIqr, format_row
from laesi_tf.benchmarks.training_speed import measure_training_speed
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.synthesis import Ranges
from laesi_tf.synthesis.presets import enable_all_components

VARIANTS = {
    "images_per_s": "synthesis",
    "every_component_images_per_s": "every component",
    "one_light_images_per_s": "one light",
    "one_light_every_component_images_per_s": "one light, every component",
}
"""Variants of the ranges whose throughput is measured: key of the metric and name in the table."""
_BACKBONES = ("small", "large")


def measure_synthesis(
    ranges: Ranges,
    *,
    seed: int,
    size: tuple[int, int],
    images: int,
    repeats: int,
    steps: int,
    weights: str,
) -> dict[str, Any]:
    """Measure memory over `images`, throughput and component costs of `ranges`, and training throughput.

    Each measurement has `repeats`; a repeat of training has `steps` timed steps. `weights` are those of the
    networks (see `laesi_tf.models.backbone`). Returns metrics by the keys that `--json` writes.
    """
    complete = enable_all_components(ranges)
    variants = (ranges, complete, ranges.with_passes(1), complete.with_passes(1))
    scene: dict[str, Any] = {"seed": seed, "size": size}
    # First, while nothing else is in memory.
    memory = measure_peak_memory(ranges, images=images, **scene)
    rates = measure_throughput(dict(zip(VARIANTS, variants, strict=True)), repeats=repeats, **scene)
    costs = measure_component_cost(complete.with_passes(1), repeats=repeats, **scene)
    loop: dict[str, Any] = {"weights": weights, "repeats": repeats, "steps": steps}
    training = {name: measure_training_speed(name, ranges, **loop, **scene) for name in _BACKBONES}
    return _collect_metrics(memory, rates, costs, training) | {"lighting_passes": ranges.lighting_passes}


def _collect_metrics(
    memory: Mapping[str, float],
    rates: Mapping[str, MedianIqr],
    costs: Mapping[str, MedianIqr],
    training: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    sources = ("cached", "live")
    return {
        **{name: rate.median for name, rate in rates.items()},
        **{f"{name}_iqr": rate.iqr for name, rate in rates.items()},
        **{f"live_over_cached_{backbone}": speed["ratio"] for backbone, speed in training.items()},
        "component_us": {name: cost.median for name, cost in costs.items()},
        "component_us_iqr": {name: cost.iqr for name, cost in costs.items()},
        "component_is_noise": {name: cost.is_noise for name, cost in costs.items()},
        "peak_rss_mb": memory["peak"],
        "settled_rss_mb": memory["settled"],
        "memory_images": memory["images"],
        "training_images_per_s": {
            backbone: {source: speed[source].median for source in sources}
            for backbone, speed in training.items()
        },
        "training_images_per_s_iqr": {
            backbone: {source: speed[source].iqr for source in sources}
            for backbone, speed in training.items()
        },
        "weights_origin": {backbone: speed["weights_origin"] for backbone, speed in training.items()},
        **describe_hardware(),
    }


def format_table(metrics: Mapping[str, Any]) -> str:
    """Format name, median and interquartile range of every metric."""
    rows = [format_row("", "median", "IQR"), *_format_rates(metrics)]
    for name, cost in metrics["component_us"].items():
        iqr = f"{metrics['component_us_iqr'][name]:.0f}"
        row = format_row(f"{name}, CPU µs per image", f"{cost:.0f}", iqr)
        rows.append(row + ("  noise" if metrics["component_is_noise"][name] else ""))
    images = metrics["memory_images"]
    settled = min(SETTLED_IMAGES, images)
    return "\n".join(
        [
            *rows,
            format_row(f"peak memory, {settled} images, MB", f"{metrics['settled_rss_mb']:.0f}"),
            format_row(f"peak memory, {images} images, MB", f"{metrics['peak_rss_mb']:.0f}"),
            "{lighting_passes} lighting passes over a leaf".format_map(metrics),
            "{machine}, {cores} cores, TensorFlow {tensorflow}, {date}".format_map(metrics),
        ]
    )


def _format_rates(metrics: Mapping[str, Any]) -> Iterator[str]:
    for key, name in VARIANTS.items():
        yield format_row(f"{name}, images/s", f"{metrics[key]:.1f}", f"{metrics[f'{key}_iqr']:.1f}")
    for backbone, rates in metrics["training_images_per_s"].items():
        for source, rate in rates.items():
            iqr = metrics["training_images_per_s_iqr"][backbone][source]
            yield format_row(f"training {backbone}, {source}, images/s", f"{rate:.1f}", f"{iqr:.1f}")
        ratio = metrics[f"live_over_cached_{backbone}"]
        yield format_row(f"training {backbone}, live over cached", f"{ratio:.3f}")
