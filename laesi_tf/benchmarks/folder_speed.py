"""Benchmark `folder`: photos per second and memory on a folder of many photos, and results after kills."""

import os
import random
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.benchmarks.predict_process import PredictRun, run_predict
from laesi_tf.benchmarks.timing import format_row
from laesi_tf.common.errors import InputError
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.progress import progress_bar
from laesi_tf.common.result_files import TABLE_FILE


def time_folder(
    photos: Sequence[Path],
    *,
    count: int,
    workers: Sequence[int],
    kills: int,
    seed: int,
    arguments: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure a folder of `count` links to `photos` with each number of `workers`.

    The run with the last of them is killed `kills` times after a random number of photos and started again;
    its seconds are those of all its parts. Where only one number is given, it is also run without a kill, as
    the tables are compared. Further `arguments` go to `predict`. Raises InputError if a run fails.
    """
    stops = sorted(random.Random(seed).sample(range(1, count), min(kills, count - 1)))
    plans: list[tuple[int, list[int]]] = [
        (number, []) for number in (workers[:-1] if stops and len(workers) > 1 else workers)
    ]
    if stops:
        plans.append((workers[-1], stops))
    runs, tables = [], []
    with tempfile.TemporaryDirectory(prefix="laesi-folder-") as name:
        folder = Path(name)
        link_photos(photos, folder / "photos", count=count)
        for order, (number, kills_at) in enumerate(progress_bar(plans, desc="runs", unit="run")):
            out, options = folder / f"out-{order}", ["--workers", str(number), *arguments]
            parts = [run_predict(folder / "photos", out, options, kill_at=stop) for stop in kills_at]
            parts.append(_require_success(run_predict(folder / "photos", out, options)))
            runs.append(_describe_run(number, parts, count))
            tables.append((out / TABLE_FILE).read_bytes())
    return {
        "photos": count,
        "different_photos": len(photos),
        "killed_after": stops,
        "identical": all(table == tables[0] for table in tables),
        "runs": runs,
        **describe_hardware(),
    }


def _describe_run(workers: int, parts: Sequence[PredictRun], count: int) -> dict[str, Any]:
    """Return the figures of a run of `count` photos in one or more `parts`."""
    seconds = sum(part.seconds for part in parts)
    return {
        "workers": workers,
        "kills": sum(part.exit_status < 0 for part in parts),
        "photos_per_s": count / seconds,
        "minutes": seconds / 60,
        "cpu_s_per_photo": sum(part.cpu_s for part in parts) / count,
        "first_photo_s": parts[0].first_photo_s,
        "peak_mb": max(part.peak_mb for part in parts),
    }


def link_photos(photos: Sequence[Path], folder: Path, *, count: int) -> None:
    """Fill `folder` with `count` hard links to `photos` in turn, or copies on another file system."""
    folder.mkdir(parents=True)
    for number in range(count):
        source = photos[number % len(photos)]
        target = folder / f"{number:05d}{source.suffix}"
        try:
            os.link(source, target)
        except OSError:
            shutil.copyfile(source, target)


def format_table(metrics: Mapping[str, Any]) -> str:
    """Format the figures of `time_folder`."""
    lines = [format_row("", "photos/s", "minutes", "CPU s", "first s", "peak MB")]
    for run in metrics["runs"]:
        kills = f", {run['kills']} kills" if run["kills"] else ""
        lines.append(
            format_row(
                f"{metrics['photos']} photos, {run['workers']} worker{'s'[: run['workers'] != 1]}{kills}",
                f"{run['photos_per_s']:.2f}",
                f"{run['minutes']:.1f}",
                f"{run['cpu_s_per_photo']:.2f}",
                f"{run['first_photo_s']:.1f}",
                f"{run['peak_mb']:.0f}",
            )
        )
    if len(metrics["runs"]) > 1:
        same = "identical" if metrics["identical"] else "NOT identical"
        lines.append(f"tables of all runs: {same}")
    if metrics["killed_after"]:
        lines.append(f"killed after {', '.join(map(str, metrics['killed_after']))} photos")
    machine = "{different_photos} different photos, {machine}, {cores} cores, LiteRT {litert}, {date}"
    return "\n".join([*lines, machine.format_map(metrics)])


def _require_success(run: PredictRun) -> PredictRun:
    if run.exit_status != 0:
        last = run.messages.strip().splitlines()[-1:] or ["no message"]
        raise InputError(f"predict ended with status {run.exit_status}: {last[0]}")
    return run
