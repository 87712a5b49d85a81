"""The journal of a folder of results: one line per measured photo, from which all other files can be written.

A line is appended as soon as its photo is measured. A process that is killed loses the photos in progress;
an incomplete last line is ignored and cut off. A line `table` says how the tables are written; the last one
holds.
"""

import contextlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import append_bytes, write_bytes
from laesi_tf.common.errors import InputError
from laesi_tf.reporting.leaf_records import COLUMNS, LeafRecord

_VERSION = 1


@dataclass(frozen=True)
class FileState:
    """What says whether a file has changed since it was measured."""

    size: int
    mtime_ns: int


def read_file_state(path: Path) -> FileState | None:
    """Return the state of the file at `path`; None where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return FileState(status.st_size, status.st_mtime_ns)


@dataclass(frozen=True, kw_only=True)
class JournalEntry:
    """The result of one photo."""

    key: str
    """Absolute path of the photo, with the number of its page."""
    state: FileState | None
    records: tuple[LeafRecord, ...]
    overlay_side: int | None = None
    """Longer side of the overlay in pixels; None without one."""
    thumbnail: str | None = None
    """JPEG in base64 for the summary page."""

    def to_line(self) -> bytes:
        """Return the entry as one line of JSON."""
        values = {
            "key": self.key,
            "state": None if self.state is None else [self.state.size, self.state.mtime_ns],
            "overlay_side": self.overlay_side,
            "records": [record.to_values() for record in self.records],
            "thumbnail": self.thumbnail,
        }
        return _to_line(values)

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> "JournalEntry":
        """Return the entry of a parsed line. Raises ValueError, KeyError or TypeError if it is none."""
        state = values["state"]
        return cls(
            key=str(values["key"]),
            state=None if state is None else FileState(*map(int, state)),
            overlay_side=values["overlay_side"],
            records=tuple(
                LeafRecord(**{name: record[name] for name in COLUMNS}) for record in values["records"]
            ),
            thumbnail=values["thumbnail"],
        )


@dataclass(frozen=True)
class EntryHead:
    """What stays in memory of an entry: all else is read from the file when it is needed."""

    offset: int
    state: FileState | None
    overlay_side: int | None
    overlay: str | None
    is_unreadable: bool


class Journal:
    """The journal at a path; it need not exist yet."""

    def __init__(self, path: Path) -> None:
        """Read the heads of all entries. Raises InputError if the file is no journal, or cannot be read."""
        self.path = path
        self.settings: dict[str, Any] | None = None
        """The settings of all measurements; None if the file does not exist."""
        self.heads: dict[str, EntryHead] = {}
        """The last entry of each photo, in the order in which the photos were first measured."""
        self.table: dict[str, Any] = {}
        """How the tables are written; empty in a journal of an earlier version."""
        self._end = 0
        if os.path.lexists(path):
            self._read()

    def create(self, settings: dict[str, Any], table: dict[str, Any]) -> None:
        """Start a journal without entries. Raises InputError where it cannot be written."""
        lines = _to_line({"laesi_journal": _VERSION, "settings": settings}) + _to_line({"table": table})
        write_bytes(self.path, lines)
        self.settings, self.table, self.heads, self._end = settings, table, {}, len(lines)

    def keep_table(self, table: dict[str, Any]) -> None:
        """Append how the tables are written if that has changed. Raises InputError where it cannot be."""
        if table != self.table:
            line = _to_line({"table": table})
            append_bytes(self.path, line)
            self.table, self._end = table, self._end + len(line)

    def append(self, entry: JournalEntry) -> None:
        """Append an entry. Raises InputError where it cannot be written, and then changes nothing."""
        line = entry.to_line()
        append_bytes(self.path, line)
        self._add_head(entry, self._end)
        self._end += len(line)

    def read_entries(self, keys: list[str]) -> Iterator[JournalEntry]:
        """Yield the last entry of each of `keys`, one at a time. Raises InputError if the file is gone."""
        try:
            with self.path.open("rb") as file:
                for key in keys:
                    file.seek(self.heads[key].offset)
                    yield JournalEntry.from_values(json.loads(file.readline()))
        except (OSError, ValueError, KeyError) as error:
            raise InputError(f"cannot read {self.path} ({error}); run the same command again") from None

    def _read(self) -> None:
        try:
            with self.path.open("rb") as file:
                self.settings = self._read_header(file.readline())
                self._end = file.tell()
                for line in file:
                    # An incomplete or damaged line is that of a photo in progress when it was killed.
                    if not line.endswith(b"\n"):
                        break
                    with contextlib.suppress(ValueError, KeyError, TypeError):
                        self._add_line(json.loads(line))
                    self._end += len(line)
                size = file.seek(0, os.SEEK_END)
            if size > self._end:
                os.truncate(self.path, self._end)
        except OSError as error:
            raise InputError(f"cannot read {self.path}: {error.strerror}; choose another --out") from None

    def _read_header(self, line: bytes) -> dict[str, Any]:
        try:
            header = json.loads(line)
            if header["laesi_journal"] == _VERSION:
                return dict(header["settings"])
        except (ValueError, KeyError, TypeError):
            pass
        raise InputError(
            f"{self.path} is no journal of this version; choose another --out, or replace it with --again"
        )

    def _add_line(self, values: dict[str, Any]) -> None:
        """Add what the line at the end says. Raises ValueError, KeyError or TypeError for a damaged one."""
        if "table" in values:
            self.table = dict(values["table"])
        else:
            self._add_head(JournalEntry.from_values(values), self._end)

    def _add_head(self, entry: JournalEntry, offset: int) -> None:
        record = entry.records[0]
        self.heads[entry.key] = EntryHead(
            offset, entry.state, entry.overlay_side, record.overlay, record.is_unreadable
        )


def _to_line(values: dict[str, Any]) -> bytes:
    return json.dumps(values).encode("ascii") + b"\n"
