"""Describe the machine that figures were measured on, and the memory that this process used."""

import datetime
import math
import os
import platform
import re
import sys
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

try:
    import resource
except ImportError:  # not on Windows
    resource = None  # type: ignore[assignment]


def describe_hardware() -> dict[str, Any]:
    """Return the processor, its cores, the versions of TensorFlow and LiteRT, and the date, to be given with
    every figure."""
    return {
        "machine": _processor_name(),
        "cores": os.cpu_count(),
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "tensorflow": _read_version("tensorflow"),
        "litert": _read_version("ai-edge-litert"),
    }


def format_hardware(hardware: Mapping[str, Any]) -> str:
    """Return what `describe_hardware` found as text."""
    return "{machine}, {cores} cores, TensorFlow {tensorflow}, {date}".format_map(hardware)


def peak_rss_mb() -> float:
    """Return the peak resident memory of this process in MB (10^6 bytes); NaN where it is not recorded."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        status = ""
    # What `getrusage` says of a process contains that of its parent, from before it became this program.
    if found := re.search(r"^VmHWM:\s*(\d+) kB$", status, re.MULTILINE):
        return int(found[1]) * 1024 / 1e6
    if resource is None:
        return math.nan
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6


def _read_version(package: str) -> str | None:
    """Return the version of a package; None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _processor_name() -> str:
    """Return the processor's name; platform.processor() gives only x86_64 on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())
