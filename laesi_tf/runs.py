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
import platform
import subprocess
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import keras
import numpy as np
import tensorflow as tf

from laesi_tf import config as configuration
from laesi_tf.config import TrainConfig
from laesi_tf.errors import InputError
from laesi_tf.files import whole, write_text
from laesi_tf.models.backbone import FROM_SCRATCH, build_backbone
from laesi_tf.tasks import task

CONFIG, STATE, HISTORY = "config.toml", "state.npz", "history.csv"
BEST, METRICS, REPORT, TENSORBOARD = "best.keras", "metrics.json", "report.html", "tensorboard"
EXPORTED, RANGES = "weights.npz", "ranges.toml"
PRETRAINED = Path(__file__).parent / "pretrained"
"""Folders `area` and `mask`: the exported runs that come with the package."""
_PACKAGES = ("laesi_tf", "tensorflow", "keras", "numpy", "opencv-contrib-python-headless")


@dataclass(frozen=True)
class Run:
    """A trained model, [B, H, W, 3] of 0..255 in, and the configuration that says what comes out."""

    path: Path
    config: TrainConfig
    model: keras.Model


@dataclass
class Progress:
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


def load_run(path: Path | str) -> Run:
    """The configuration and best model in a run's folder; InputError if missing, unfinished or broken."""
    path = Path(path)
    if not (path / CONFIG).is_file():
        raise InputError(f"no run in {path}: it has no {CONFIG}; name a folder that train wrote with --out")
    config = configuration.load(path / CONFIG)
    if (path / RANGES).is_file():  # they may have changed, or be gone, where they came from
        config = replace(config, ranges=str(path / RANGES))
    best = path / BEST
    if (path / EXPORTED).is_file():
        return Run(path, config, _exported(path / EXPORTED, config))
    if not best.is_file():
        raise InputError(f"run {path} has no {BEST} yet: let train reach its first validation")
    try:
        model = keras.models.load_model(best, compile=False)
    except Exception as error:  # zipfile, h5py, JSON and Keras each have their own
        raise InputError(f"{best} is broken or from another Keras version: train it again") from error
    return Run(path, config, model)


def export(run: Run, out: Path) -> None:
    """Write `run` into folder `out` as it is shipped: half the size, and without what only training needs.

    Raises InputError where `out` has files of something other than an export.
    """
    if out.is_dir() and any(out.iterdir()) and (not (out / EXPORTED).is_file() or (out / BEST).exists()):
        raise InputError(f"{out} is neither empty nor an exported run; choose another --out")
    weights = {f"variable_{i}": variable.numpy().astype(np.float16) for i, variable in _numbered(run.model)}
    with whole(out / EXPORTED) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **weights)
    # Where files lay is nobody else's business: they are told by their names, or are copied.
    copied = [name for name in ("ranges", "mixture") if (run.path / f"{name}.toml").is_file()]
    paths: dict[str, Any] = {name: f"{name}.toml" for name in copied}
    paths |= {name: Path(getattr(run.config, name)).name for name in ("weights", "textures")}
    named = replace(run.config, **paths)
    configuration.write(out / CONFIG, named, configuration.read(run.path / CONFIG)[configuration.PROVENANCE])
    for name in (METRICS, *(f"{name}.toml" for name in copied)):
        if (run.path / name).is_file():
            write_text(out / name, (run.path / name).read_text(encoding="utf-8"))


def _exported(path: Path, config: TrainConfig) -> keras.Model:
    base, _ = build_backbone(config.backbone, size=config.size, alpha=config.alpha, weights=FROM_SCRATCH)
    model = task(config).build(base)
    try:
        with np.load(path, allow_pickle=False) as saved:
            for index, variable in _numbered(model):
                variable.assign(saved[f"variable_{index}"].astype(np.float32))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is broken or does not fit its {CONFIG}: export the run again") from error
    return model


def _numbered(model: keras.Model) -> Iterable[tuple[int, Any]]:
    """The variables of a model that hold what it learned, statistics included, in its order."""
    return enumerate(model.weights)


def begin(path: Path, config: TrainConfig, origin: str) -> None:
    """Write what a new run is made from."""
    configuration.write(path / CONFIG, config, _provenance(origin))
    for name, file in _named_files(config).items():
        write_text(path / f"{name}.toml", file.read_text(encoding="utf-8"))


def origin_of(path: Path, config: TrainConfig) -> str | None:
    """The weights' origin of the run that `path` holds, None if there is none yet.

    InputError if the folder is not a run's, or if the run was configured otherwise.
    """
    if not path.exists():
        return None
    if not path.is_dir():
        raise InputError(f"{path} is a file; choose another --out")
    if not (path / CONFIG).is_file():
        if any(path.iterdir()):
            raise InputError(f"{path} is neither empty nor a run's folder; choose another --out")
        return None
    keys = configuration.differing(configuration.load(path / CONFIG), config)
    for name, file in _named_files(config).items():
        if not keys and (path / f"{name}.toml").read_bytes() != file.read_bytes():
            keys = [f"{name} (the file changed)"]
    if keys:
        raise InputError(
            f"{path} holds a run that differs in {', '.join(keys)}; "
            "continue it with its own configuration or choose another --out"
        )
    return configuration.read(path / CONFIG)[configuration.PROVENANCE]["weights_origin"]


def save_state(path: Path, progress: Progress, variables: Sequence[Any]) -> None:
    """Write what the run continues from, whole or not at all."""
    values = {f"variable_{index}": variable.numpy() for index, variable in enumerate(variables)}
    with whole(path / STATE) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, progress=np.array(json.dumps(asdict(progress))), **values)


def load_state(path: Path, variables: Sequence[Any]) -> Progress:
    """Set `variables` to what was saved and return the progress; as it started where nothing was saved."""
    if not (path / STATE).is_file():
        return Progress()
    try:
        with np.load(path / STATE, allow_pickle=False) as saved:
            for index, variable in enumerate(variables):
                variable.assign(saved[f"variable_{index}"])
            return Progress(**json.loads(str(saved["progress"])))
    except (OSError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"{path / STATE} is broken or of another version; choose another --out") from error


def write_history(path: Path, rows: Sequence[Mapping[str, float]]) -> None:
    """Write one line per validation; figures to seven digits."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: f"{value:.7g}" for key, value in row.items()} for row in rows)
    write_text(path / HISTORY, text.getvalue())


def log(writer: tf.summary.SummaryWriter, row: Mapping[str, float]) -> None:
    """Add a row of the history to TensorBoard's log, which needs TensorBoard for reading only."""
    kind = tf.compat.v1.SummaryMetadata()
    kind.plugin_data.plugin_name = "scalars"
    with writer.as_default(step=int(row["step"])):
        for key, value in row.items():
            if key != "step":
                tf.summary.write(key, tf.constant(value, tf.float32), metadata=kind)
    writer.flush()


def _named_files(config: TrainConfig) -> dict[str, Path]:
    """The TOML files that a configuration names, by its key."""
    paths = {"ranges": Path(config.ranges), "mixture": Path(config.mixture)}
    return {name: path for name, path in paths.items() if path.suffix == ".toml" and path.is_file()}


def _provenance(origin: str) -> dict[str, Any]:
    packages = {name: _version(name) for name in _PACKAGES}
    return {
        "weights_origin": origin,
        "git_commit": _commit(),
        "python": platform.python_version(),
        "packages": {name: version for name, version in packages.items() if version},
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _commit() -> str:
    """The commit this package is checked out at, "+changes" if its files differ; empty outside a checkout."""
    folder = Path(__file__).parent

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(folder), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # not merely installed inside someone's repository
        return git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return ""
