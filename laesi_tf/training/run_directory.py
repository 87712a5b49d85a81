"""A run's folder: what it was made from, how far it is, how it went, its best model.

config.toml     the configuration and where the run came from
ranges.toml     a copy of the ranges, if they came from a file
mixture.toml    a copy of the mixture, if there was one
state.npz       variables and progress that a killed run continues from
history.csv     one row per validation
tensorboard/    the same for TensorBoard
best.keras      the model with the best validation score
weights.npz     in its place in an exported run: the same model's variables as float16
metrics.json    its figures; written last, so its presence says that the run is finished
report.html     all of it for reading
"""

import csv
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.common import schema
from laesi_tf.common.atomic_files import atomic_write, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import CONFIG_FILE, HISTORY_FILE, STATE_FILE
from laesi_tf.training import config_files
from laesi_tf.training.config import TrainConfig, differing_fields
from laesi_tf.training.provenance import collect_provenance


@dataclass
class TrainingProgress:
    """How far a run is; with the variables' values, all that it needs to continue."""

    step: int = 0
    seconds: float = 0.0  # from start to now, without the time between a kill and the next start
    timed_steps: int = 0  # steps and seconds spent on steps, for images/s
    timed_seconds: float = 0.0
    loss_sum: float = 0.0  # since the last row
    loss_count: int = 0
    best_merit: float | None = None
    best_step: int = 0
    stale: int = 0  # validations since the best
    history: list[dict[str, float]] = field(default_factory=list)


def create_run_directory(path: Path, config: TrainConfig, origin: str) -> None:
    """Write what a new run is made from."""
    config_files.save_config(path / CONFIG_FILE, config, collect_provenance(origin))
    for name, file in _referenced_files(config).items():
        write_text(path / f"{name}.toml", file.read_text(encoding="utf-8"))


def check_run_directory(path: Path, config: TrainConfig) -> str | None:
    """The weights' origin of the run that `path` holds, None if there is none yet.

    InputError if the folder is not a run's, or if the run was configured otherwise.
    """
    if not path.exists():
        return None
    if not path.is_dir():
        raise InputError(f"{path} is a file; choose another --out")
    if not (path / CONFIG_FILE).is_file():
        if any(path.iterdir()):
            raise InputError(f"{path} is neither empty nor a run's folder; choose another --out")
        return None
    keys = differing_fields(config_files.load_config(path / CONFIG_FILE), config)
    for name, file in _referenced_files(config).items():
        if not keys and (path / f"{name}.toml").read_bytes() != file.read_bytes():
            keys = [f"{name} (the file changed)"]
    if keys:
        raise InputError(
            f"{path} holds a run that differs in {', '.join(keys)}; "
            "continue it with its own configuration or choose another --out"
        )
    return schema.read_toml(path / CONFIG_FILE)[config_files.PROVENANCE]["weights_origin"]


def save_state(path: Path, progress: TrainingProgress, variables: Sequence[Any]) -> None:
    """Write what the run continues from, whole or not at all."""
    values = {f"variable_{index}": variable.numpy() for index, variable in enumerate(variables)}
    with atomic_write(path / STATE_FILE) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, progress=np.array(json.dumps(asdict(progress))), **values)


def restore_state(path: Path, variables: Sequence[Any]) -> TrainingProgress:
    """Set `variables` to what was saved and return the progress; as it started where nothing was saved."""
    if not (path / STATE_FILE).is_file():
        return TrainingProgress()
    try:
        with np.load(path / STATE_FILE, allow_pickle=False) as saved:
            for index, variable in enumerate(variables):
                variable.assign(saved[f"variable_{index}"])
            return TrainingProgress(**json.loads(str(saved["progress"])))
    except (OSError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path / STATE_FILE} is broken or of another version; choose another --out"
        ) from error


def write_history(path: Path, rows: Sequence[Mapping[str, float]]) -> None:
    """Write one line per validation; figures to seven digits."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: f"{value:.7g}" for key, value in row.items()} for row in rows)
    write_text(path / HISTORY_FILE, text.getvalue())


def log_to_tensorboard(writer: tf.summary.SummaryWriter, row: Mapping[str, float]) -> None:
    """Add a row of the history to TensorBoard's log, which needs TensorBoard for reading only."""
    kind = tf.compat.v1.SummaryMetadata()
    kind.plugin_data.plugin_name = "scalars"
    with writer.as_default(step=int(row["step"])):
        for key, value in row.items():
            if key != "step":
                tf.summary.write(key, tf.constant(value, tf.float32), metadata=kind)
    writer.flush()


def _referenced_files(config: TrainConfig) -> dict[str, Path]:
    """The TOML files that a configuration names, by its key."""
    paths = {"ranges": Path(config.ranges), "mixture": Path(config.mixture)}
    return {name: path for name, path in paths.items() if path.suffix == ".toml" and path.is_file()}
