"""Benchmark `start`: time and memory of a process that measures one photo, from its start."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.benchmarks.predict_process import run_predict
from laesi_tf.benchmarks.timing import MedianIqr, format_row
from laesi_tf.common.errors import InputError
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.progress import progress_bar


def time_starts(photos: Sequence[Path], *, repeats: int, arguments: Sequence[str] = ()) -> dict[str, Any]:
    """Measure each photo in `repeats` processes of its own; return medians over all, and their IQR.

    Further `arguments` go to `predict`. Raises InputError if a process fails.
    """
    first, whole, cpu, peaks = [], [], [], []
    for photo in progress_bar([photo for photo in photos for _ in range(repeats)], desc="starts"):
        with tempfile.TemporaryDirectory(prefix="laesi-start-") as folder:
            run = run_predict(photo, Path(folder), arguments)
        if run.exit_status != 0:
            raise InputError(f"predict ended with status {run.exit_status}: {run.messages.strip()}")
        first.append(run.first_photo_s)
        whole.append(run.seconds)
        cpu.append(run.cpu_s)
        peaks.append(run.peak_mb)
    return {
        "photos": len(photos),
        "repeats": repeats,
        **_summarise("first_area_s", first),
        **_summarise("whole_s", whole),
        **_summarise("cpu_s", cpu),
        **_summarise("peak_mb", peaks),
        "largest_peak_mb": max(peaks),
        **describe_hardware(),
    }


def format_table(metrics: Mapping[str, Any]) -> str:
    """Format the figures of `time_starts`."""
    rows = [
        format_row("start of the process to first area, s", *_cells(metrics, "first_area_s", 2)),
        format_row("to its end, s", *_cells(metrics, "whole_s", 2)),
        format_row("processor time to its end, s", *_cells(metrics, "cpu_s", 2)),
        format_row("peak memory, MB", *_cells(metrics, "peak_mb", 0)),
    ]
    machine = "{photos} photos, {repeats} starts each, {machine}, {cores} cores, LiteRT {litert}, {date}"
    return "\n".join([format_row("", "median", "IQR"), *rows, machine.format_map(metrics)])


def _summarise(name: str, values: Sequence[float]) -> dict[str, float]:
    measured = MedianIqr.of(values)
    return {name: measured.median, f"{name}_iqr": measured.iqr}


def _cells(metrics: Mapping[str, Any], name: str, digits: int) -> tuple[str, str]:
    return f"{metrics[name]:.{digits}f}", f"{metrics[f'{name}_iqr']:.{digits}f}"
