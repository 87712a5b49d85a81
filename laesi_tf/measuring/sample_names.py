"""Names of samples for photos, from a CSV file of two columns: file and sample."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath

from laesi_tf.common.errors import InputError
from laesi_tf.measuring.photo_tasks import PhotoTask

_HEADERS = frozenset({"file", "photo", "image", "filename", "file name", "name"})
"""First cells, in lower case, of a row that is a header."""
_MAX_NAMED = 5


@dataclass
class SampleNames:
    """The samples of photos, and what did not match."""

    samples: dict[str, str] = field(default_factory=dict)
    """Sample by the key of its photo."""
    without_photo: list[str] = field(default_factory=list)
    """Files in the list that are none of the photos."""
    without_name: list[str] = field(default_factory=list)
    """Photos that are not in the list."""

    def describe_mismatches(self) -> list[str]:
        """Return a line for each kind of mismatch."""
        lines = []
        if self.without_photo:
            lines.append(f"names without a photo: {_shorten(self.without_photo)}")
        if self.without_name:
            lines.append(f"photos without a name: {_shorten(self.without_name)}")
        return lines


def read_sample_rows(path: Path) -> list[tuple[str, str]]:
    """Read the rows (file, sample) of a CSV with commas, semicolons or tabs. Raises InputError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check the path of --names") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not UTF-8; save it as CSV UTF-8") from None
    first = text.partition("\n")[0]
    delimiter = max(";\t,", key=first.count)
    rows = []
    for number, cells in enumerate(csv.reader(text.splitlines(), delimiter=delimiter), 1):
        cells = [cell.strip() for cell in cells]
        if not any(cells) or (number == 1 and cells[0].lower() in _HEADERS):
            continue
        if len(cells) < 2 or not cells[0] or not cells[1] or any(cells[2:]):
            raise InputError(f"{path} row {number}: {cells} is not a file and its sample; write two columns")
        rows.append((cells[0], cells[1]))
    if not rows:
        raise InputError(f"{path} has no rows; write two columns, file and sample")
    return rows


def match_samples(rows: Sequence[tuple[str, str]], tasks: Sequence[PhotoTask], source: Path) -> SampleNames:
    """Match the files of `rows` to the photos of `tasks`.

    A file is named by its name, or by the end of its path where two folders have files of that name; case is
    ignored if no name matches exactly. `scan.tif#2` is a page, `scan.tif` all pages. Raises InputError, which
    names `source`, where a row matches photos in several folders, and where two samples claim one photo.
    """
    index: dict[str, list[PhotoTask]] = {}
    for task in tasks:
        for name in {task.page.path.name, task.page.name}:
            index.setdefault(name.lower(), []).append(task)
    names = SampleNames()
    for file, sample in rows:
        matches = _find_photos(PurePath(file.replace("\\", "/")), index)
        folders = {task.page.path for task in matches}
        if len(folders) > 1:
            first, second = sorted(map(str, folders))[:2]
            raise InputError(f"{source}: {file} is both {first} and {second}; write its folder, too")
        if not matches:
            names.without_photo.append(file)
        for task in matches:
            if names.samples.setdefault(task.key, sample) != sample:
                raise InputError(
                    f"{source}: {task.page} has the samples {names.samples[task.key]} and {sample}; keep one"
                )
    names.without_name = [str(task.page) for task in tasks if task.key not in names.samples]
    return names


def _find_photos(file: PurePath, index: dict[str, list[PhotoTask]]) -> list[PhotoTask]:
    """Return the tasks whose path ends with `file`, those with the same case if there are any."""
    alike = index.get(file.name.lower(), [])
    lower = _parts(str(file).lower())
    found = [task for task in alike if _ends_with(str(task.page).lower(), lower, task)]
    exact = [task for task in found if _ends_with(str(task.page), _parts(str(file)), task)]
    return exact or found


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
