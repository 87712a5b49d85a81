"""The processor that figures were measured on, and the memory that this process used."""

import datetime
import math
import os
import platform
import sys
from pathlib import Path
from typing import Any

import tensorflow as tf

try:
    import resource
except ImportError:  # Windows keeps no such account
    resource = None  # type: ignore[assignment]


def describe_hardware() -> dict[str, Any]:
    """The processor, its cores, TensorFlow's version and the date, which every figure should come with."""
    return {
        "machine": _processor_name(),
        "cores": os.cpu_count(),
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "tensorflow": tf.__version__,
    }


def peak_rss_mb() -> float:
    """Peak resident memory of this process so far in MB (10^6 bytes); NaN where it is not kept."""
    if resource is None:
        return math.nan
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6


def _processor_name() -> str:
    """The processor's name; platform.processor() says no more than x86_64 on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())
