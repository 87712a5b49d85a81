"""Measure photos in threads and keep each result as soon as it is there."""

import itertools
import os
from collections.abc import Callable, Sequence

from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.prefetch import prefetch
from laesi_tf.measuring.journal import JournalEntry
from laesi_tf.measuring.photo_tasks import PhotoTask
from laesi_tf.measuring.results_folder import ResultsFolder

_MAX_WORKERS = 8
"""More threads by default only wait: each measurement uses several cores by itself."""


def default_workers() -> int:
    """Return the number of cores that this process may use, at most eight."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(available, _MAX_WORKERS)


def measure_photos(
    measure: Callable[[PhotoTask], JournalEntry],
    tasks: Sequence[PhotoTask],
    results: ResultsFolder,
    *,
    workers: int,
    finished: int = 0,
) -> None:
    """Measure `tasks` in `workers` threads and add the results in the order of the tasks.

    Threads rather than processes: decoding, OpenCV and LiteRT run outside Python's lock, and each process
    would load the networks anew; with a training run, TensorFlow would trace its graphs anew, which takes ten
    seconds and a gigabyte.
    `finished` further photos were measured before, and are shown as such. Raises InputError and
    KeyboardInterrupt with a message that says what was kept.
    """
    total = finished + len(tasks)
    try:
        # With a training run, threads would trace graphs at the same time, and each for itself.
        first = prefetch(measure, tasks[:1], workers=1)
        others = prefetch(measure, tasks[1:], depth=2 * workers, workers=workers)
        measured = itertools.chain(first, others)
        for _, entry in progress_bar(measured, total=total, initial=finished, desc="measuring", unit="photo"):
            if isinstance(entry, InputError):
                raise entry
            results.add(entry)
    except InputError as error:
        raise InputError(f"{error}{_describe_kept(results, total, '; ')}") from None
    except KeyboardInterrupt:
        kept = _describe_kept(results, total, ": ")
        raise KeyboardInterrupt(f"interrupted{kept}") from None


def _describe_kept(results: ResultsFolder, total: int, separator: str) -> str:
    if not results.is_written:
        return ""
    return (
        f"{separator}the results of {results.count_measured()} of {total} photos are in {results.table}; the "
        "same command (without --again) continues"
    )
