"""The options of commands that start worker processes on this machine."""

import argparse
import os
from pathlib import Path
from typing import Any

from laesi_tf.common.parsing import positive_int
from sweeps.queue.study_storage import LOCATION_HELP, artifact_folder


def add_worker_arguments(parser: argparse.ArgumentParser, *, storage: str, time_limit_s: float) -> None:
    """Add --storage, --folder, --workers, --threads and --time-limit, which `RetryPolicy` checks."""
    parser.add_argument("--storage", default=storage, help=LOCATION_HELP)
    parser.add_argument(
        "--folder",
        type=Path,
        help="folder of artifacts and checkpoints (default: that of the storage's file)",
    )
    parser.add_argument(
        "--workers", type=positive_int, default=min(4, os.cpu_count() or 1), help="processes on this machine"
    )
    parser.add_argument(
        "--threads", type=positive_int, help="threads of each worker (default: its share of the cores)"
    )
    parser.add_argument(
        "--time-limit", type=float, default=time_limit_s, metavar="S", help="seconds that a trial may take"
    )


def worker_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of `WorkerSettings` that these options give."""
    return {
        "storage": options.storage,
        "folder": options.folder or artifact_folder(options.storage),
        "threads": options.threads or max(1, (os.cpu_count() or 1) // options.workers),
    }
