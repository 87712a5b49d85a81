"""Names of samples for photos, from a CSV file of two columns: file and sample."""

import csv
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from laesi_tf.common.errors import InputError
from laesi_tf.measuring.photo_tasks import PhotoTask

_HEADERS = frozenset({"file", "photo", "image", "filename", "file name", "name"})
"""First cells, in lower case, of a row that is a header."""
_MAX_NAMED = 5


class SampleRow(NamedTuple):
    """A row of a list of names."""

    file: str
    sample: str
    photo: str | None = None
    """Absolute path of the file that the row was matched to: from then on it names no other."""


@dataclass(frozen=True)
class SampleNames:
    """A list of names, and the samples of the photos of a folder of results."""

    source: str = ""
    """Absolute path of the list; empty while none was given."""
    digest: str = ""
    """SHA-256 of the list as it was read."""
    rows: tuple[SampleRow, ...] = ()
    samples: Mapping[str, str] = field(default_factory=dict)
    """Sample by the key of its photo. Photos that this list does not name can have one of an earlier list."""

    def to_values(self) -> dict[str, Any]:
        """Return the names as JSON values."""
        return {
            "source": self.source,
            "digest": self.digest,
            "rows": [list(row) for row in self.rows],
            "samples": dict(self.samples),
        }

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> "SampleNames":
        """Return the names of `to_values`. Raises KeyError, TypeError or ValueError for damaged values."""
        return cls(
            source=str(values["source"]),
            digest=str(values["digest"]),
            rows=tuple(
                SampleRow(str(file), str(sample), None if photo is None else str(photo))
                for file, sample, photo in values["rows"]
            ),
            samples={str(key): str(sample) for key, sample in dict(values["samples"]).items()},
        )

    def has_changed(self) -> bool:
        """Return whether the list is still there and differs from what was read."""
        path = Path(self.source)
        try:
            return path.is_file() and _digest(path.read_bytes()) != self.digest
        except OSError:
            return False


def read_sample_names(path: Path) -> SampleNames:
    """Read a CSV of rows (file, sample) with commas, semicolons or tabs. Raises InputError.

    A header alone is a list without names.
    """
    try:
        content = path.read_bytes()
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check the path of --names") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not UTF-8; save it as CSV UTF-8") from None
    lines = text.splitlines()
    first = lines[0] if lines else ""
    delimiter = max(";\t,", key=first.count)
    rows, has_header = [], False
    for number, cells in enumerate(csv.reader(lines, delimiter=delimiter), 1):
        cells = [cell.strip() for cell in cells]
        if number == 1 and cells and cells[0].lower() in _HEADERS:
            has_header = True
            continue
        if not any(cells):
            continue
        if len(cells) < 2 or not cells[0] or not cells[1] or any(cells[2:]):
            raise InputError(f"{path} row {number}: {cells} is not a file and its sample; write two columns")
        rows.append(SampleRow(cells[0], cells[1]))
    if not rows and not has_header:
        raise InputError(f"{path} has no rows; write two columns, file and sample")
    return SampleNames(str(path.absolute()), _digest(content), tuple(rows))


def name_photos(tasks: Sequence[PhotoTask], kept: SampleNames, given: SampleNames | None) -> SampleNames:
    """Return the names of a folder that keeps the names `kept`, for a command on `tasks`.

    A list that the command has `given` replaces the kept one and the samples of `tasks`; other photos keep
    their samples, and the rows that named them. Without it, `tasks` that have no sample yet are matched to
    the kept list.

    A file is named by its name, or by the end of its path where two folders have files of that name; case is
    ignored if no name matches exactly. `scan.tif#2` is a page, `scan.tif` all pages. Raises InputError, which
    names the list, where a row matches photos in several folders, and where two samples claim one photo.
    """
    names, remedy = kept, ", and give the list again with --names"
    if given is not None:
        keys = {task.key for task in tasks}
        others = {key: sample for key, sample in kept.samples.items() if key not in keys}
        names, remedy = replace(given, samples=others), ""
    index: dict[str, list[PhotoTask]] = {}
    for task in tasks:
        if task.key not in names.samples:
            for name in {task.page.path.name, task.page.name}:
                index.setdefault(name.lower(), []).append(task)
    earlier = {row[:2]: row.photo for row in kept.rows}
    rows, samples = [], dict[str, str]()
    for row in names.rows:
        matches = _find_photos(row, index)
        files = {_path_of(task): task.page.path for task in matches}
        if len(files) > 1:
            first, second = sorted(map(str, files.values()))[:2]
            raise InputError(
                f"{names.source}: {row.file} is both {first} and {second}; write its folder, too{remedy}"
            )
        for task in matches:
            if samples.setdefault(task.key, row.sample) != row.sample:
                raise InputError(
                    f"{names.source}: {task.page} has the samples {samples[task.key]} and {row.sample}; keep "
                    f"one{remedy}"
                )
        rows.append(row._replace(photo=next(iter(files), earlier.get(row[:2]))))
    return replace(names, rows=tuple(rows), samples={**names.samples, **samples})


def describe_mismatches(names: SampleNames, tasks: Sequence[PhotoTask], *, is_given: bool) -> list[str]:
    """Return a line for each kind of mismatch between `names` and the photos of a command.

    `is_given` says whether the command named the list.
    """
    lines = []
    if is_given and (unmatched := [row.file for row in names.rows if row.photo is None]):
        lines.append(f"names without a photo: {_shorten(unmatched)}")
    unnamed = [str(task.page) for task in tasks if task.key not in names.samples]
    if unnamed and (is_given or names.rows):
        lines.append(f"photos without a name: {_shorten(unnamed)}")
    return lines


def _find_photos(row: SampleRow, index: Mapping[str, Sequence[PhotoTask]]) -> list[PhotoTask]:
    """Return the tasks whose path ends with the row's file, those with the same case if there are any."""
    file = PurePath(row.file.replace("\\", "/"))
    alike = [task for task in index.get(file.name.lower(), []) if row.photo in (None, _path_of(task))]
    lower = _parts(str(file).lower())
    found = [task for task in alike if _ends_with(str(task.page).lower(), lower, task)]
    exact = [task for task in found if _ends_with(str(task.page), _parts(str(file)), task)]
    return exact or found


def _path_of(task: PhotoTask) -> str:
    """Return the absolute path of a photo's file."""
    return task.key.removesuffix(task.page.ending)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _ends_with(path: str, parts: tuple[str, ...], task: PhotoTask) -> bool:
    ending = task.page.ending.lower()
    for candidate in (path, path.removesuffix(ending) if ending else path):
        if _parts(candidate)[-len(parts) :] == parts:
            return True
    return False


def _parts(path: str) -> tuple[str, ...]:
    return tuple(part for part in PurePath(path).parts if part != ".")


def _shorten(names: Sequence[str]) -> str:
    more = "" if len(names) <= _MAX_NAMED else f" and {len(names) - _MAX_NAMED} more"
    return f"{len(names)} ({', '.join(names[:_MAX_NAMED])}{more})"
