"""Check that an exported network equals the run it comes from."""

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from laesi_tf.common import schema
from laesi_tf.common.atomic_files import atomic_write, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import BEST_MODEL_FILE, CONFIG_FILE, EXPORTED_WEIGHTS_FILE, METRICS_FILE
from laesi_tf.data import synthetic
from laesi_tf.models.saved_model import Run, numbered_weights
from laesi_tf.training import config_files
from laesi_tf.training.tasks import make_task
from laesi_tf.training.trainer import evaluate_network

_BATCHES, _BATCH = 4, 32


def compute_test_metrics(trained: Run) -> dict[str, float]:
    """The model's figures on the first scenes of the test stretch."""
    scenes = synthetic.synthetic_batches(
        task="mask" if trained.config.task == "mask" else "area",
        batch_size=_BATCH,
        seed=0,
        size=trained.config.size,
        ranges=trained.config.ranges,
        start=synthetic.TEST_INDICES[0],
        passes=1,
    )
    judged = make_task(trained.config)
    found = evaluate_network(trained.model, judged, list(itertools.islice(scenes, _BATCHES)))
    return {key: float(np.asarray(value)) for key, value in judged.figures(found).items()}


def export_float16(run: Run, out: Path) -> None:
    """Write `run` into folder `out` as it is shipped: half the size, and without what only training needs.

    Raises InputError where `out` has files of something other than an export.
    """
    if (
        out.is_dir()
        and any(out.iterdir())
        and (not (out / EXPORTED_WEIGHTS_FILE).is_file() or (out / BEST_MODEL_FILE).exists())
    ):
        raise InputError(f"{out} is neither empty nor an exported run; choose another --out")
    weights = {
        f"variable_{i}": variable.numpy().astype(np.float16) for i, variable in numbered_weights(run.model)
    }
    with atomic_write(out / EXPORTED_WEIGHTS_FILE) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **weights)
    # Where files lay is nobody else's business: they are told by their names, or are copied.
    copied = [name for name in ("ranges", "mixture") if (run.path / f"{name}.toml").is_file()]
    paths: dict[str, Any] = {name: f"{name}.toml" for name in copied}
    paths |= {name: Path(getattr(run.config, name)).name for name in ("weights", "textures")}
    named = replace(run.config, **paths)
    config_files.save_config(
        out / CONFIG_FILE, named, schema.read_toml(run.path / CONFIG_FILE)[config_files.PROVENANCE]
    )
    for name in (METRICS_FILE, *(f"{name}.toml" for name in copied)):
        if (run.path / name).is_file():
            write_text(out / name, (run.path / name).read_text(encoding="utf-8"))
