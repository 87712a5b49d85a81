"""The folder of results: journal, tables, provenance and summary page, consistent at any time."""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import require_writable
from laesi_tf.common.errors import InputError
from laesi_tf.common.result_files import JOURNAL_FILE, PAGE_FILE, PROVENANCE_FILE, TABLE_FILE
from laesi_tf.measuring.folder_lock import FolderLock
from laesi_tf.measuring.journal import Journal, JournalEntry
from laesi_tf.measuring.photo_tasks import PhotoTask
from laesi_tf.measuring.provenance import keep_edited_table
from laesi_tf.measuring.sample_names import SampleNames
from laesi_tf.measuring.table_options import TableOptions
from laesi_tf.reporting.record_tables import CSV_FORMATS, JSON_LINES, RecordTable


class ResultsFolder:
    """Keeps what was measured, and says which photos need not be measured again."""

    def __init__(
        self,
        folder: Path,
        settings: dict[str, Any],
        *,
        csv: str | None = None,
        json_lines: Path | None = None,
        again: bool = False,
    ) -> None:
        """Look at what is in `folder`, which need not exist, and change nothing.

        `settings` are all that a measurement depends on beside the photo. `csv` names a dialect of
        `CSV_FORMATS`; without it the folder keeps its own. `json_lines` is a further table. With `again`, all
        photos are measured: earlier results of the same settings are replaced one by one, those of other
        settings all together as soon as a photo can be read. Raises InputError if the folder has results that
        were measured with other settings, or a table of another origin.
        """
        self.folder = folder
        self.table = folder / TABLE_FILE
        self.settings = settings
        _require_replaceable(self.table)
        self._lock = FolderLock(folder)
        # Reading cuts off an incomplete line, which must not be one that another command is writing.
        self._lock.acquire()
        try:
            self._journal = self._open_journal(again)
        except InputError:
            self._lock.release()
            raise
        self.kept_options = TableOptions.from_values(self._journal.table)
        """How earlier commands wrote the tables."""
        self._options = replace(self.kept_options, csv=csv or self.kept_options.csv)
        self._tables = [RecordTable(self.table, CSV_FORMATS[self._options.csv])]
        if json_lines is not None:
            self._tables.append(RecordTable(json_lines, JSON_LINES))
        self._measures_all = again
        self._replaces_all = again and self._journal.settings != settings
        """Whether all that is in the folder is replaced."""
        self._is_open = False
        self._waiting: list[JournalEntry] = []
        """Photos that cannot be read, while no photo could be read: then nothing is written."""
        self._in_table: list[str] = []
        """Keys in the order of the tables' rows."""
        self._labels: dict[str, str] = {}
        """Photos as this command names them, by key."""
        self._new_overlays: set[str] = set()
        self.kept_copy: Path | None = None
        """Where the earlier table is if somebody had changed it."""

    @property
    def overlays(self) -> dict[str, str]:
        """Names of the overlays of earlier runs by the key of their photo."""
        if self._replaces_all:
            return {}
        return {key: head.overlay for key, head in self._journal.heads.items() if head.overlay is not None}

    def list_foreign_files(self) -> set[str]:
        """Return the names, in lower case, of the files in a folder that no command has written into."""
        if os.path.lexists(self.folder / JOURNAL_FILE) or not self.folder.is_dir():
            return set()
        return {path.name.lower() for path in self.folder.iterdir()}

    def is_measured(self, task: PhotoTask, *, overlay_side: int | None) -> bool:
        """Return whether the photo has not changed since it was measured, and has the overlay that is wanted.

        A photo that could not be read is tried again.
        """
        head = None if self._measures_all else self._journal.heads.get(task.key)
        if head is None or head.is_unreadable or head.state is None or head.state != task.state:
            return False
        if overlay_side is None:
            return True
        is_same = head.overlay_side == overlay_side
        return is_same and head.overlay is not None and (self.folder / head.overlay).exists()

    def open(
        self, tasks: Sequence[PhotoTask], names: SampleNames, *, overlay_side: int | None
    ) -> list[PhotoTask]:
        """Return the tasks that must be measured, and write the tables of the others.

        The folder keeps `names` and the dialect for later commands.
        """
        self._options = replace(self._options, names=names)
        self._labels = {task.key: str(task.page) for task in tasks}
        self._new_overlays = set() if overlay_side is None else {task.overlay for task in tasks}
        todo = [task for task in tasks if not self.is_measured(task, overlay_side=overlay_side)]
        missing = {task.key for task in todo}
        if not self._replaces_all and self._journal.settings is not None:
            self._is_open = True
            # Before the tables, so that a command after an interruption writes them in the same way.
            self._journal.keep_table(self._options.to_values())
            self.kept_copy = keep_edited_table(self.table, self.folder / PROVENANCE_FILE)
            self._rewrite_tables([key for key in self._order() if key not in missing])
        return todo

    def add(self, entry: JournalEntry) -> None:
        """Keep the result of a photo. Raises InputError where it cannot be written; earlier ones remain."""
        if not self._is_open and entry.records[0].is_unreadable:
            self._waiting.append(entry)
            return
        waiting, self._waiting = self._waiting, []
        if not self._is_open:
            self._start_anew()
        for each in (*waiting, entry):
            self._journal.append(each)
            for table in self._tables:
                table.append(self._present(each).records)
            self._in_table.append(each.key)

    def sort_tables(self) -> None:
        """Bring the rows of the tables into order: earlier photos, then those of this command."""
        if self._is_open and (order := self._order()) != self._in_table:
            self._rewrite_tables(order)

    def __enter__(self) -> "ResultsFolder":
        """Return this object."""
        return self

    def __exit__(self, *_: object) -> None:
        """Let other commands write into the folder."""
        self._lock.release()

    @property
    def is_written(self) -> bool:
        """Whether there are results in the folder."""
        return self._is_open

    def count_measured(self) -> int:
        """Return the number of photos of this command that have a result."""
        return sum(key in self._journal.heads for key in self._labels) if self._is_open else 0

    def count_others(self) -> int:
        """Return the number of photos in the tables that this command does not name."""
        return sum(key not in self._labels for key in self._journal.heads) if self._is_open else 0

    def read_entries(self) -> Iterator[JournalEntry]:
        """Yield the results of the photos of this command, in its order."""
        if not self._is_open:
            yield from map(self._present, self._waiting)
            return
        keys = [key for key in self._labels if key in self._journal.heads]
        yield from map(self._present, self._journal.read_entries(keys))

    def read_all_entries(self) -> Iterator[JournalEntry]:
        """Yield the results of all photos in the tables, in the order of the tables."""
        yield from map(self._present, self._journal.read_entries(self._order()))

    def _open_journal(self, again: bool) -> Journal:
        path = self.folder / JOURNAL_FILE
        if again:
            # A damaged journal is replaced, too.
            with contextlib.suppress(InputError):
                return Journal(path)
            return Journal(Path(os.devnull) / "none")
        journal = Journal(path)
        if journal.settings is None:
            for existing in (self.table, self.folder / PAGE_FILE):
                if os.path.lexists(existing):
                    raise InputError(
                        f"{existing} exists, and {path.name}, which says where it is from, does not; choose "
                        "another --out, or replace it with --again"
                    )
        elif journal.settings != self.settings:
            changes = "; ".join(_describe_changes(journal.settings, self.settings))
            raise InputError(
                f"{self.table} was measured with other settings ({changes}); choose another --out, or "
                "measure all photos anew with --again"
            )
        return journal

    def _start_anew(self) -> None:
        """Write an empty journal and tables; with `again`, delete the overlays of the earlier results."""
        self.kept_copy = keep_edited_table(self.table, self.folder / PROVENANCE_FILE)
        for head in self._journal.heads.values():
            # Those of photos that are measured again are replaced; the first of them exists already.
            name = head.overlay
            if name is not None and name not in self._new_overlays and Path(name).name == name:
                (self.folder / name).unlink(missing_ok=True)
        self._journal.path = self.folder / JOURNAL_FILE
        self._journal.create(self.settings, self._options.to_values())
        self._is_open = True
        self._lock.acquire()
        self._rewrite_tables([])

    def _order(self) -> list[str]:
        """Return the keys of all results: of photos that this command does not name, then of its own."""
        others = [key for key in self._journal.heads if key not in self._labels]
        return others + [key for key in self._labels if key in self._journal.heads]

    def _rewrite_tables(self, keys: list[str]) -> None:
        for table in self._tables:
            entries = map(self._present, self._journal.read_entries(keys))
            table.rewrite(record for entry in entries for record in entry.records)
        self._in_table = list(keys)

    def _present(self, entry: JournalEntry) -> JournalEntry:
        """Return `entry` with the photo as this command names it, and with the name of its sample."""
        label = self._labels.get(entry.key, entry.records[0].photo)
        sample = self._options.names.samples.get(entry.key)
        records = (replace(record, photo=label, sample=sample) for record in entry.records)
        return replace(entry, records=tuple(records))


def _require_replaceable(table: Path) -> None:
    """Raise InputError if `table` cannot be written, also where only its own permission says so."""
    require_writable(table)
    # Whoever may write into a folder can replace a protected file in it, but somebody protected it.
    if table.is_file() and not table.stat().st_mode & 0o222:
        raise InputError(f"cannot write {table}: it is write-protected; choose another --out")


def _describe_changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for name in sorted({*before, *now}):
        if before.get(name) != now.get(name):
            yield f"{name}: {before.get(name)}, now {now.get(name)}"
