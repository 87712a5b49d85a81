"""Run `predict` as a process of its own, watch its progress and memory, and kill it at will."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from laesi_tf.common.result_files import JOURNAL_FILE

_POLL_S = 0.02


@dataclass(frozen=True)
class PredictRun:
    """One process."""

    exit_status: int
    """Negative if it was killed by a signal."""
    seconds: float
    first_photo_s: float
    """Until the first result was kept: start, networks and their graphs included."""
    longest_photo_s: float
    """Longest time between two results after the first."""
    peak_mb: float
    """Peak resident memory in 10^6 bytes."""
    cpu_s: float
    """Processor time of all its threads, which hardly depends on what else the machine does."""
    messages: str
    """What it wrote to stderr."""


class ResultCounter:
    """Counts the results in the journal of a folder, and reads only what is new."""

    def __init__(self, out: Path) -> None:
        """Take a folder, which need not exist yet."""
        self._path = out / JOURNAL_FILE
        self._offset = self._results = 0

    def count(self) -> int:
        """Return the number of results by now."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._offset)
                new = file.read()
        except OSError:
            return 0
        complete = new[: new.rfind(b"\n") + 1]
        self._offset += len(complete)
        # Other lines say what the journal is, and how its tables are written.
        self._results += sum(line.startswith(b'{"key"') for line in complete.splitlines())
        return self._results


def run_predict(
    photos: Path, out: Path, arguments: Sequence[str] = (), *, kill_at: int | None = None
) -> PredictRun:
    """Run `predict` on the folder `photos`; kill it once its journal has `kill_at` results.

    The system reports the peak memory of an ended child: Unix only.
    """
    command = [sys.executable, "-m", "laesi_tf", "predict", str(photos), "--out", str(out), *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [_source_folder(), *sys.path]))}
    with tempfile.TemporaryFile() as errors:
        started = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors, env=environment)
        counter = ResultCounter(out)
        results, first, longest, latest = counter.count(), 0.0, 0.0, started
        while True:
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            now, count = time.perf_counter(), counter.count()
            if count != results:
                longest = max(longest, now - latest) if first else 0.0
                first = first or now - started
                results, latest = count, now
            if ended:
                break
            if kill_at is not None and count >= kill_at:
                process.kill()
            time.sleep(_POLL_S)
        process.returncode = os.waitstatus_to_exitcode(status)
        errors.seek(0)
        messages = errors.read().decode("utf-8", errors="replace")
    peak = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6
    cpu_s = usage.ru_utime + usage.ru_stime
    return PredictRun(process.returncode, now - started, first, longest, peak, cpu_s, messages)


def _source_folder() -> Path:
    return Path(__file__).parents[2]
