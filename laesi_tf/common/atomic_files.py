"""Write files completely or not at all: to a temporary file in the same folder, which is then renamed."""

import contextlib
import csv
import errno
import hashlib
import json
import math
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.common.errors import InputError

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


@contextlib.contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path with `path`'s suffix in the same folder; on success rename it to `path`.

    Missing folders are made. Raises InputError where the folder cannot be made or written, where the disk is
    full, and where `path` cannot be replaced.
    """
    path = Path(path)
    temporary = _create_beside(path)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        # Windows denies replacing a file that another program has open.
        if error.errno in (*_NO_SPACE, errno.EACCES, errno.EPERM):
            raise _unwritable_error(path, error) from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


def require_distinct(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise InputError if one of `outputs` is one of the files `inputs`, which would be lost."""
    read = {path.resolve() for path in inputs}
    for path in outputs:
        if path.resolve() in read:
            raise InputError(f"{path} would be replaced, and this command reads it; choose another --out")


def require_writable(path: Path | str) -> None:
    """Raise InputError if `path` cannot be written: called before the work starts, and leaves no trace."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; name a file in it")
    existing = next(folder for folder in path.absolute().parents if folder.exists())
    try:
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        raise _unwritable_error(path, error) from error


def _create_beside(path: Path) -> Path:
    """Create an empty file in the folder of `path`, which is made where it is missing. Raises InputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise _unwritable_error(path, error) from error
    os.close(handle)
    return Path(name)


def _unwritable_error(path: Path, error: OSError) -> InputError:
    if error.errno in _NO_SPACE:
        remedy = "free some space, then run the same command again"
    elif error.errno in (errno.ENOENT, errno.EIO, errno.ESTALE, errno.ENODEV, errno.ENOTCONN):
        remedy = "its folder has vanished; connect the drive, then run the same command again"
    else:
        remedy = "choose a folder you may write to"
    return InputError(f"cannot write {path}: {os.strerror(error.errno or 0)}; {remedy}")


def append_bytes(path: Path | str, content: bytes) -> None:
    """Append `content` to an existing file, whole or not at all. Raises InputError where it cannot.

    A file that has vanished, as on a network drive, is not made anew.
    """
    path = Path(path)
    try:
        with path.open("r+b", buffering=0) as file:
            end = file.seek(0, os.SEEK_END)
            try:
                written = 0
                while written < len(content):
                    written += file.write(content[written:])
            except OSError:
                file.truncate(end)
                raise
    except OSError as error:
        raise _unwritable_error(path, error) from error


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write `content`."""
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` as UTF-8."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path | str, value: Any) -> None:
    """Write `value` as JSON; NaN and infinities become null, since JSON has neither."""
    write_text(path, json.dumps(_replace_nonfinite(value), indent=2, allow_nan=False) + "\n")


def read_json(path: Path | str) -> Any:
    """Return the content of a JSON file. Raises InputError where it is missing or broken."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path} is broken ({error}); delete it and make it again") from None


def write_figure(path: Path | str, figure: Any, *, dpi: int = 110) -> None:
    """Write a Matplotlib `figure` as PNG."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=dpi)


def short_sha256(path: Path | str) -> str:
    """Return the first 16 digits of a file's SHA-256: enough to distinguish files of the same name."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]


def write_csv(path: Path | str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write `rows` below `header` as CSV; None becomes an empty cell.

    Text that a spreadsheet would run as a formula, as the name of a photo can be, gets an apostrophe before
    it.
    """
    with (
        atomic_write(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="replace", newline="") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([escape_formula(cell) for cell in row] for row in rows)


def escape_formula(cell: Any) -> Any:
    """Return `cell` with an apostrophe before text that a spreadsheet would run as a formula."""
    if not isinstance(cell, str) or not cell.startswith(_FORMULA_STARTS) or _is_number(cell):
        return cell
    return f"'{cell}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _replace_nonfinite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _replace_nonfinite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_nonfinite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
