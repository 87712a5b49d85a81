"""Short trainings on discs, see `discs`."""

import csv
from pathlib import Path
from typing import Any

import discs
import numpy as np

from laesi_tf.common.run_files import HISTORY_FILE
from laesi_tf.models.saved_model import load_run
from laesi_tf.training import loop
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.run_summary import TrainingResult
from laesi_tf.training.trainer import BatchStream

SIZE, BATCH = 32, 8


def tiny_config(**changes: Any) -> TrainConfig:
    """Return a configuration of 12 steps that takes seconds."""
    options = {"alpha": 0.35, "size": SIZE, "batch_size": BATCH, "steps": 12, "weights": "none"}
    return TrainConfig(**options | {"validate_every": 2, "checkpoint_every": 5} | changes)


def disc_stream(config: TrainConfig, **options: Any) -> BatchStream:
    """Return batches of discs for the task, size and batch size of `config`."""
    return lambda start: discs.stream(
        task=config.task, batch_size=config.batch_size, size=config.size[0], start=start, **options
    )


def fit_discs(config: TrainConfig, out: Path, **options: Any) -> TrainingResult:
    """Train on discs, validate on 24 others."""
    validation = disc_stream(config, count=24)(10**6)
    defaults = {"train": disc_stream(config), "validation": validation, "show_progress": False}
    return loop.fit(config, out, **defaults | options)


def read_history(out: Path) -> list[dict[str, str]]:
    """Return the rows of history.csv."""
    with (out / HISTORY_FILE).open() as file:
        return list(csv.DictReader(file))


def learning_curve(out: Path) -> list[dict[str, str]]:
    """Return the history without what the clock decides."""
    clock = ("minutes", "images_per_s")
    return [{key: value for key, value in row.items() if key not in clock} for row in read_history(out)]


def network_variables(out: Path) -> list[np.ndarray]:
    """Return the variables of a run's best network."""
    return [variable.numpy() for variable in load_run(out).model.variables]
