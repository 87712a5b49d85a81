"""State what a table of measurements depends on, so that it can be repeated and cited."""

import datetime
import hashlib
import json
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.run_files import (
    BEST_MODEL_FILE,
    CONFIG_FILE,
    EXPORTED_WEIGHTS_FILE,
    NETWORK_FILE,
    PRETRAINED,
    READING_FILE,
)
from laesi_tf.measuring.journal import read_file_state

_PACKAGE = Path(__file__).parents[1]
_MEASURING_CODE = ("common", "data", "estimators", "models")
"""Folders of the package that an area depends on."""
_PACKAGES = (
    *("ai-edge-litert", "numpy", "opencv-contrib-python-headless", "pillow", "pillow-heif"),
    *("tensorflow", "keras"),
)
_DIGEST_LETTERS = 16


def list_models(
    *,
    run: Path | None,
    mask_run: Path | None,
    ruling_run: Path | None,
    guess: bool,
    has_known_scale: bool,
) -> dict[str, Path | str]:
    """Return the models that `estimators.factory.load_estimator` loads for these arguments.

    The values are run directories by task, an exported file, or the name of a method without a network.
    """
    if run is not None and not guess:
        return {"model": run}
    mask = mask_run or PRETRAINED / "mask"
    if has_known_scale:
        return {"mask": mask} if mask_run is not None else {"mask": mask, "background": "plain"}
    models: dict[str, Path | str] = {"mask": mask, "ruling": ruling_run or PRETRAINED / "ruling"}
    return {**models, "area": run or PRETRAINED / "area"} if guess else models


def describe_settings(
    models: Mapping[str, Path | str],
    *,
    px_per_mm: float | None,
    dpi: float | str | None,
    grid_mm: float | None,
) -> dict[str, Any]:
    """Return all that an area depends on beside the photo; results with other settings are not mixed.

    `models` are those of `list_models`, of which digests are returned.
    """
    return {
        "version": metadata.version("laesi_tf"),
        "code": _digest_code(),
        "models": {task: _digest_run(run) for task, run in sorted(models.items())},
        "px_per_mm": px_per_mm,
        "dpi": dpi,
        "grid_mm": grid_mm,
    }


def write_provenance(
    path: Path, settings: Mapping[str, Any], models: Mapping[str, Path | str], *, table: Path, photos: int
) -> None:
    """Write the provenance of the results at `path`. Raises InputError where it cannot be written.

    `photos` is the number of photos in `table`.
    """
    state = read_file_state(table)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    values = {
        "software": "laesi_tf",
        "settings": dict(settings),
        "model_paths": {task: str(run) for task, run in sorted(models.items())},
        "python": platform.python_version(),
        "packages": {name: _read_version(name) for name in _PACKAGES},
        "written": now,
        "photos": photos,
        "table": None if state is None else {"size": state.size, "mtime_ns": state.mtime_ns},
    }
    write_json(path, values)


def keep_edited_table(table: Path, provenance: Path) -> Path | None:
    """Move `table` aside if it was changed since its provenance was written; return where it is then."""
    state = read_file_state(table)
    try:
        written = json.loads(provenance.read_text(encoding="utf-8"))["table"]
        is_edited = state is not None and (state.size, state.mtime_ns) != (
            written["size"],
            written["mtime_ns"],
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None
    # An interruption leaves a table that is newer than its provenance: without it, nothing is known.
    provenance.unlink(missing_ok=True)
    if not is_edited:
        return None
    number, copy = 1, table.with_name(f"{table.stem}.edited{table.suffix}")
    while copy.exists():
        number += 1
        copy = table.with_name(f"{table.stem}.edited-{number}{table.suffix}")
    return table.rename(copy)


def _digest_code() -> str:
    """Return a digest of the code that measures: the version alone does not change with each commit."""
    digest = hashlib.sha256()
    for folder in _MEASURING_CODE:
        for path in sorted((_PACKAGE / folder).rglob("*.py")):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:_DIGEST_LETTERS]


def _digest_run(run: Path | str) -> str:
    """Return a digest of a run's network and configuration, or of a file; the name of a method as it is."""
    if Path(run).is_file():
        return hashlib.sha256(Path(run).read_bytes()).hexdigest()[:_DIGEST_LETTERS]
    digest, is_run = hashlib.sha256(), False
    for name in (CONFIG_FILE, BEST_MODEL_FILE, EXPORTED_WEIGHTS_FILE, NETWORK_FILE, READING_FILE):
        path = Path(run) / name
        if path.is_file():
            is_run = True
            digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()[:_DIGEST_LETTERS] if is_run else str(run)


def _read_version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
