"""The graphs that the page runs: converted from the shipped networks, or exported files of the user's."""

import tempfile
from collections.abc import Container
from pathlib import Path

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import PRETRAINED
from laesi_tf.estimators.litert_file import read_litert_file

PHOTO = "photo.tflite"
GUIDANCE = "guidance.tflite"
_GRAPHS = {PHOTO: ("photo", "float32"), GUIDANCE: ("guidance", "dynamic")}
"""Kind and precision of the graphs. In a browser, the measurement with float16 weights takes three times as
long as with float32 (tests/compare_browser.py), as its loops convert the weights in each turn."""


def read_photo_model(path: Path) -> bytes:
    """Return the content of an exported file of kind `photo`. Raises InputError for another one."""
    kind = read_litert_file(path).metadata.get("kind")
    if kind != "photo":
        raise InputError(f"{path} is a file of kind {kind!r}; name a laesi-photo-*.tflite of laesi export")
    return path.read_bytes()


def convert_models(*, without: Container[str] = ()) -> dict[str, bytes]:
    """Return the files that the page runs by name, but for those in `without`, from the shipped networks.

    Takes a minute for the whole measurement.
    """
    from laesi_tf.estimators.keras_networks import load_run_of
    from laesi_tf.estimators.litert_file import write_litert_file
    from laesi_tf.exporting.app_folder import name_run
    from laesi_tf.exporting.litert import build_graph, convert, describe

    runs = {task: load_run_of(task, PRETRAINED / task) for task in ("area", "mask", "ruling")}
    files = {}
    for name, (kind, variant) in _GRAPHS.items():
        if name in without:
            continue
        graph = build_graph(kind, runs["mask"], runs["ruling"], runs["area"])
        details = describe(kind, {task: name_run(run) for task, run in runs.items()}) | {"variant": variant}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            write_litert_file(path, convert(graph, variant), details)
            files[name] = path.read_bytes()
    return files
