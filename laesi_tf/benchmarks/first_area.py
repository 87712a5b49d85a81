"""Measure one photo in a process of its own: what a person waits for, and the memory that it takes."""

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from laesi_tf.benchmarks.methods import Method
from laesi_tf.common.errors import InputError


class FirstArea(NamedTuple):
    """A process that measured one photo and ended."""

    seconds: float
    """From the start of Python to the area."""
    peak_mb: float
    """Peak resident memory in 10^6 bytes."""


def measure_first_area(method: Method, photo: Path, px_per_mm: float | None) -> FirstArea:
    """Run a process that loads `method` and measures `photo`. Raises InputError if it fails."""
    started = time.time()
    command = [sys.executable, "-m", __name__, json.dumps(asdict(method)), str(photo), json.dumps(px_per_mm)]
    environment = os.environ | {"TF_CPP_MIN_LOG_LEVEL": "3"}
    process = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if process.returncode:
        last = process.stderr.strip().splitlines()[-1:] or ["no message"]
        raise InputError(f"{method.name} cannot measure {photo} in a process of its own: {last[0]}")
    result = json.loads(process.stdout.splitlines()[-1])
    return FirstArea(result["ended"] - started, result["peak_mb"])


def _main(method: str, photo: str, px_per_mm: str) -> None:
    from laesi_tf.common.hardware import peak_rss_mb
    from laesi_tf.data.decoding import decode_photo
    from laesi_tf.estimators.base import PhotoInfo

    estimator = Method(**json.loads(method)).load()
    estimator.measure(decode_photo(Path(photo)), PhotoInfo(px_per_mm=json.loads(px_per_mm)))
    print(json.dumps({"ended": time.time(), "peak_mb": peak_rss_mb()}))


if __name__ == "__main__":
    _main(*sys.argv[1:])
