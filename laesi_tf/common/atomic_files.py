"""Files that are written completely or not at all: first beside their place, then renamed into it."""

import contextlib
import csv
import hashlib
import json
import math
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.common.errors import InputError


@contextlib.contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path with `path`'s suffix in the same folder; on success rename it to `path`.

    Raises InputError where the folder cannot be made or written.
    """
    path = Path(path)
    temporary = _create_beside(path)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def require_writable(path: Path | str) -> None:
    """Raise InputError if `path` cannot be written: asked before the work, and leaving no trace."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; name a file in it")
    existing = next(folder for folder in path.absolute().parents if folder.exists())
    try:
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        raise _unwritable_error(path, error) from error


def _create_beside(path: Path) -> Path:
    """A new empty file in the folder of `path`, which is made where it is missing. Raises InputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise _unwritable_error(path, error) from error
    os.close(handle)
    return Path(name)


def _unwritable_error(path: Path, error: OSError) -> InputError:
    return InputError(f"cannot write {path}: {error.strerror}; choose a folder you may write to")


def write_text(path: Path | str, text: str) -> None:
    """Write `text` as UTF-8, whole or not at all."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path | str, value: Any) -> None:
    """Write `value` as JSON, whole or not at all; NaN and infinities become null, as JSON has neither."""
    write_text(path, json.dumps(_replace_nonfinite(value), indent=2, allow_nan=False) + "\n")


def read_json(path: Path | str) -> Any:
    """What a JSON file holds. Raises InputError where it is missing or broken."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path} is broken ({error}); delete it and make it again") from None


def write_figure(path: Path | str, figure: Any, *, dpi: int = 110) -> None:
    """Write a Matplotlib `figure` as PNG, whole or not at all."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=dpi)


def short_sha256(path: Path | str) -> str:
    """The first 16 digits of a file's SHA-256, which tell it from others of its name."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]


def write_csv(path: Path | str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write `rows` below `header`, whole or not at all; None becomes an empty cell.

    Text that a spreadsheet would run as a formula, as a photo's name may be, gets an apostrophe before it.
    """
    with (
        atomic_write(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="replace", newline="") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([_escape_formula(cell) for cell in row] for row in rows)


def _escape_formula(cell: Any) -> Any:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r")) else cell


def _replace_nonfinite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _replace_nonfinite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_nonfinite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
