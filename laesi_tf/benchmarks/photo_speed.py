"""Benchmark `photo`: measure how long it takes to decode and to measure a photo."""

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import tensorflow as tf
from PIL import Image

from laesi_tf.benchmarks.component_cost import trace_renderer
from laesi_tf.benchmarks.timing import MedianIqr, format_row
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.decoding import decode_photo
from laesi_tf.estimators.base import Estimator
from laesi_tf.synthesis import load_ranges

_SCENE_PX = 1600
"""Longer side of the rendered scene, pixels."""
_PASSES = 4
"""Successive indices that show the same leaf."""


def time_photos(estimator: Estimator, *, seed: int, size: tuple[int, int], repeats: int) -> dict[str, Any]:
    """Time decoding and measuring a photo of `size` (h, w); return medians over scenes in ms, and their IQR.

    A scene is rendered at 1600 pixels and enlarged: in a phone's photo, single pixels carry no detail either.
    """
    # One traced graph for all scenes: rendering eagerly traces functions again and again, with warnings.
    render = trace_renderer(load_ranges("rendering_2"), seed=seed, size=_scene_size(size))
    times: dict[str, list[float]] = {"decode": [], "measure": []}
    methods = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "photo.jpg"
        for number in progress_bar(range(repeats + 1), desc="photos", unit="photo"):
            image = render(tf.constant(number * _PASSES, tf.int64))["image"].numpy()
            enlarged = cv2.resize(image, size[::-1], interpolation=cv2.INTER_CUBIC)
            Image.fromarray(enlarged).save(path, quality=90)
            started = time.perf_counter()
            photo = decode_photo(path)
            decoded = time.perf_counter()
            measurement = estimator.measure(photo)
            times["decode"].append((decoded - started) * 1e3)
            times["measure"].append((time.perf_counter() - decoded) * 1e3)
            methods.append(measurement.method)
    # The first photo prepares memory; with a training run, it traces graphs.
    summary = {name: MedianIqr.of(values[1:]) for name, values in times.items()}
    return {
        "megapixels": size[0] * size[1] / 1e6,
        "photos": repeats,
        "methods": sorted(set(methods[1:])),
        **{f"{name}_ms": measured.median for name, measured in summary.items()},
        **{f"{name}_ms_iqr": measured.iqr for name, measured in summary.items()},
        **describe_hardware(),
    }


def _scene_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return `size` with its longer side reduced to 1600 pixels."""
    scale = min(1.0, _SCENE_PX / max(size))
    return round(size[0] * scale), round(size[1] * scale)


def format_table(metrics: Mapping[str, Any]) -> str:
    """Format the medians and interquartile ranges of `time_photos`."""
    rows = [
        format_row(
            f"{name}, {metrics['megapixels']:.1f} megapixels, ms",
            f"{metrics[f'{name}_ms']:.0f}",
            f"{metrics[f'{name}_ms_iqr']:.0f}",
        )
        for name in ("decode", "measure")
    ]
    machine = "{photos} photos, {machine}, {cores} cores, LiteRT {litert}, {date}".format_map(metrics)
    return "\n".join(
        [
            format_row("", "median", "IQR"),
            *rows,
            f"measured by {', '.join(metrics['methods'])}",
            machine,
        ]
    )
