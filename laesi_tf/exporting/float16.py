"""Export a run directory with float16 weights, and check that the exported network equals the original."""

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from laesi_tf.common import schema
from laesi_tf.common.atomic_files import atomic_write, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import (
    BEST_MODEL_FILE,
    CONFIG_FILE,
    EXPORTED_WEIGHTS_FILE,
    METRICS_FILE,
    NETWORK_FILE,
    RANGES_FILE,
    READING_FILE,
)
from laesi_tf.data import synthetic
from laesi_tf.models.saved_model import Run, named_weights
from laesi_tf.synthesis import load_ranges
from laesi_tf.training import config_files
from laesi_tf.training.tasks import make_task
from laesi_tf.training.trainer import evaluate_network

_BATCHES, _BATCH_SIZE = 4, 32
_COPIED_FILES = ("ranges", "mixture")
"""Keys of the configuration that may name a TOML file, of which a run directory holds a copy."""


def export_float16(run: Run, out: Path) -> None:
    """Write `run` to folder `out` with float16 weights and without what only training needs.

    Raises InputError if `out` holds anything but an earlier export.
    """
    check_export_folder(out)
    # Those of the weights before; `package` writes them anew.
    for name in (NETWORK_FILE, READING_FILE):
        (out / name).unlink(missing_ok=True)
    weights = {name: variable.numpy().astype(np.float16) for name, variable in named_weights(run.model)}
    with atomic_write(out / EXPORTED_WEIGHTS_FILE) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **weights)
    copied = [name for name in _COPIED_FILES if (run.path / f"{name}.toml").is_file()]
    # An export is given to others: it must not reveal the folders of the machine it was trained on.
    config = config_files.load_config(run.path / CONFIG_FILE)
    names: dict[str, Any] = {name: f"{name}.toml" for name in copied}
    names |= {name: Path(getattr(config, name)).name for name in ("weights", "textures")}
    provenance = schema.read_toml(run.path / CONFIG_FILE)[config_files.PROVENANCE]
    config_files.save_config(out / CONFIG_FILE, replace(config, **names), provenance)
    for name in (METRICS_FILE, *(f"{name}.toml" for name in copied)):
        if (run.path / name).is_file():
            write_text(out / name, (run.path / name).read_text(encoding="utf-8"))


def check_export_folder(out: Path) -> None:
    """Raise InputError if `out` is a file or a folder that holds anything but an earlier export."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; choose another --out")
    is_export = (out / EXPORTED_WEIGHTS_FILE).is_file() and not (out / BEST_MODEL_FILE).exists()
    if out.is_dir() and any(out.iterdir()) and not is_export:
        raise InputError(f"{out} is neither empty nor an exported run; choose another --out")


def compute_test_metrics(run: Run) -> dict[str, float]:
    """Evaluate `run` on the first scenes of the test indices; return the metrics of its task."""
    config = config_files.load_config(run.path / CONFIG_FILE)
    ranges = run.path / RANGES_FILE
    task = make_task(config)
    scenes = synthetic.synthetic_batches(
        make_target=task.make_target,
        batch_size=_BATCH_SIZE,
        seed=0,
        size=run.spec.size,
        ranges=task.choose_ranges(load_ranges(ranges if ranges.is_file() else config.ranges)),
        start=synthetic.TEST_INDICES[0],
        passes=1,
        render=task.renderer(),
    )
    arrays = evaluate_network(run.model, task, list(itertools.islice(scenes, _BATCHES)))
    return {key: float(np.asarray(value)) for key, value in task.aggregate(arrays).items()}
