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

    With the last of them it is measured once more, killed `kills` times after a random number of photos and
    started again. Further `arguments` go to `predict`. Raises InputError if a run fails.
    """
    runs: dict[int, PredictRun] = {}
    with tempfile.TemporaryDirectory(prefix="laesi-folder-") as name:
        folder = Path(name)
        link_photos(photos, folder / "photos", count=count)
        for number in progress_bar(workers, desc="runs", unit="run"):
            options = ["--workers", str(number), *arguments]
            runs[number] = _require_success(run_predict(folder / "photos", folder / f"{number}", options))
        options = ["--workers", str(workers[-1]), *arguments]
        stops = sorted(random.Random(seed).sample(range(1, count), min(kills, count - 1)))
        for stop in stops:
            run_predict(folder / "photos", folder / "killed", options, kill_at=stop)
        _require_success(run_predict(folder / "photos", folder / "killed", options))
        tables = [(folder / f"{number}" / TABLE_FILE).read_bytes() for number in workers]
        killed = (folder / "killed" / TABLE_FILE).read_bytes()
    return {
        "photos": count,
        "different_photos": len(photos),
        "killed_after": stops,
        "identical_after_kills": killed == tables[-1],
        "identical_for_all_workers": all(table == tables[0] for table in tables),
        "runs": {
            str(number): {
                "photos_per_s": count / run.seconds,
                "photos_per_s_after_first": (count - 1) / (run.seconds - run.first_photo_s),
                "first_photo_s": run.first_photo_s,
                "peak_mb": run.peak_mb,
            }
            for number, run in runs.items()
        },
        **describe_hardware(),
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
    lines = [format_row("", "photos/s", "later", "first s", "peak MB")]
    for number, run in metrics["runs"].items():
        lines.append(
            format_row(
                f"{metrics['photos']} photos, {number} worker{'' if number == '1' else 's'}",
                f"{run['photos_per_s']:.2f}",
                f"{run['photos_per_s_after_first']:.2f}",
                f"{run['first_photo_s']:.1f}",
                f"{run['peak_mb']:.0f}",
            )
        )
    same = {True: "identical", False: "NOT identical"}
    lines.append(f"tables of all numbers of workers: {same[metrics['identical_for_all_workers']]}")
    stops = ", ".join(map(str, metrics["killed_after"]))
    lines.append(f"table after kills at {stops} photos: {same[metrics['identical_after_kills']]}")
    machine = "{different_photos} different photos, {machine}, {cores} cores, LiteRT {litert}, {date}"
    return "\n".join([*lines, machine.format_map(metrics)])


def _require_success(run: PredictRun) -> PredictRun:
    if run.exit_status != 0:
        last = run.messages.strip().splitlines()[-1:] or ["no message"]
        raise InputError(f"predict ended with status {run.exit_status}: {last[0]}")
    return run
