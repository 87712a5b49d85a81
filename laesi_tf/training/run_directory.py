"""A run directory: creating it, checking it, and the state that a stopped run continues from.

`laesi_tf.common.run_files` lists its files.
"""

import csv
import io
import json
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.common.atomic_files import atomic_write, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import (
    CONFIG_FILE,
    HISTORY_FILE,
    METRICS_FILE,
    MIXTURE_FILE,
    RANGES_FILE,
    STATE_FILE,
)
from laesi_tf.common.schema import list_differing_fields, read_toml
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.config_files import PROVENANCE, load_config, save_config
from laesi_tf.training.provenance import collect_provenance


@dataclass
class TrainingProgress:
    """How far a run is; with the values of the variables, all that it needs to continue.

    The names of the fields are keys in state.npz.
    """

    step: int = 0
    seconds: float = 0.0
    """From start to now, without the time between a stop and the next start."""
    timed_steps: int = 0
    """Since the last validation, as are `timed_seconds`, `loss_sum` and `loss_count`."""
    timed_seconds: float = 0.0
    loss_sum: float = 0.0
    loss_count: int = 0
    best_merit: float | None = None
    """Ranking score of the best network so far."""
    best_step: int = 0
    stale: int = 0
    """Validations since the best one."""
    history: list[dict[str, float]] = field(default_factory=list)

    @property
    def mean_loss(self) -> float:
        """Mean training loss since the last validation."""
        return self.loss_sum / max(1, self.loss_count)


def create_run_directory(
    path: Path, config: TrainConfig, weights_origin: str, devices: Mapping[str, Any] | None = None
) -> None:
    """Write the configuration of a new run, where it comes from, and copies of the files that it names.

    `devices` are entries about what trains it, for the table of where it comes from.
    """
    save_config(path / CONFIG_FILE, config, collect_provenance(weights_origin) | dict(devices or {}))
    for file, copy in _referenced_files(config).values():
        write_text(path / copy, file.read_text(encoding="utf-8"))


def check_run_directory(path: Path, config: TrainConfig) -> str | None:
    """Return the origin of the weights of the run in `path`, or None if there is none yet.

    Raises InputError if `path` is something else than a run directory, or if the run has another
    configuration. Only `steps` may grow, and only where the learning rate is constant: the other schedules
    end with the steps.
    """
    if not path.exists():
        return None
    if not path.is_dir():
        raise InputError(f"{path} is a file; choose another --out")
    if not (path / CONFIG_FILE).is_file():
        if any(path.iterdir()):
            raise InputError(f"{path} is neither empty nor a run directory; choose another --out")
        return None
    earlier = load_config(path / CONFIG_FILE)
    names = list_differing_fields(earlier, config)
    if names == ["steps"] and config.steps > earlier.steps:
        if config.schedule != "constant":
            raise InputError(
                f"{path} has {earlier.steps} steps, with which its {config.schedule} learning rate ends; "
                f"to train on from its network, choose another --out and --weights {path}"
            )
        names = []
    if not names:
        for name, (file, copy) in _referenced_files(config).items():
            if (path / copy).read_bytes() != file.read_bytes():
                names = [f"{name} (the file changed)"]
    if names:
        raise InputError(
            f"{path} holds a run that differs in {', '.join(names)}; "
            "continue it with its own configuration or choose another --out"
        )
    origin: str = read_toml(path / CONFIG_FILE)[PROVENANCE]["weights_origin"]
    return origin


def is_finished(path: Path, config: TrainConfig) -> bool:
    """Whether `path` holds a finished run of `config`, which `check_run_directory` found to be the same."""
    return (path / METRICS_FILE).is_file() and load_config(path / CONFIG_FILE).steps >= config.steps


def record_start(path: Path, config: TrainConfig, devices: Mapping[str, Any]) -> None:
    """Record in the run directory with which `devices` a run continues, and whether it shall have more steps
    than before; it is then unfinished."""
    provenance = read_toml(path / CONFIG_FILE)[PROVENANCE]
    has_more_steps = load_config(path / CONFIG_FILE).steps < config.steps
    if has_more_steps or provenance != provenance | devices:
        save_config(path / CONFIG_FILE, config, provenance | devices)
    if has_more_steps:
        (path / METRICS_FILE).unlink(missing_ok=True)


def save_state(path: Path, progress: TrainingProgress, variables: Sequence[Any]) -> None:
    """Write the state that a run continues from."""
    values = {f"variable_{index}": variable.numpy() for index, variable in enumerate(variables)}
    with atomic_write(path / STATE_FILE) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, progress=np.array(json.dumps(asdict(progress))), **values)


def restore_state(path: Path, variables: Sequence[Any]) -> TrainingProgress:
    """Set `variables` to the saved values and return the progress; that of a new run if nothing was saved."""
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
    """Write one line per validation, with seven significant digits."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: f"{value:.7g}" for key, value in row.items()} for row in rows)
    write_text(path / HISTORY_FILE, text.getvalue())


def log_to_tensorboard(writer: tf.summary.SummaryWriter, row: Mapping[str, float]) -> None:
    """Add a row of the history to TensorBoard's log, which needs TensorBoard only for reading.

    Raises InputError where the log cannot be written, as on a full disk.
    """
    kind = tf.compat.v1.SummaryMetadata()
    kind.plugin_data.plugin_name = "scalars"
    try:
        with writer.as_default(step=int(row["step"])):
            for key, value in row.items():
                if key != "step":
                    tf.summary.write(key, tf.constant(value, tf.float32), metadata=kind)
        writer.flush()
    except tf.errors.OpError as error:
        raise InputError(
            f"cannot write TensorBoard's log: {error.message}; "
            "free some space, then run the same command again"
        ) from error


def digest_config(config: TrainConfig) -> int:
    """Return a checksum of a configuration and of the content of the TOML files that it names."""
    contents = [file.read_bytes() for file, _ in _referenced_files(config).values()]
    return zlib.crc32(b"\0".join([repr(config).encode(), *contents]))


def _referenced_files(config: TrainConfig) -> dict[str, tuple[Path, str]]:
    """Return the TOML files that a configuration names, by key, each with the name of its copy in the run."""
    files = {"ranges": (Path(config.ranges), RANGES_FILE), "mixture": (Path(config.mixture), MIXTURE_FILE)}
    return {name: pair for name, pair in files.items() if pair[0].suffix == ".toml" and pair[0].is_file()}
