"""Tables of leaf records that grow while photos are measured: CSV in three dialects, and JSON lines."""

import csv
import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from laesi_tf.common.atomic_files import append_bytes, atomic_write, escape_formula
from laesi_tf.reporting.leaf_records import COLUMNS, LeafRecord

_BOM = "\ufeff"


@dataclass(frozen=True)
class TableFormat:
    """How records become the lines of a file."""

    header: str
    """What the file begins with."""
    format_record: Callable[[LeafRecord], str]
    """Returns a record's line."""


def _make_csv_format(*, delimiter: str = ",", decimal: str = ".", has_bom: bool = False) -> TableFormat:
    def format_cells(cells: Sequence[object]) -> str:
        text = io.StringIO()
        csv.writer(text, delimiter=delimiter).writerow(cells)
        return text.getvalue()

    def format_record(record: LeafRecord) -> str:
        return format_cells([format_cell(cell) for cell in record.to_values().values()])

    def format_cell(cell: object) -> object:
        return repr(cell).replace(".", decimal) if isinstance(cell, float) else escape_formula(cell)

    return TableFormat((_BOM if has_bom else "") + format_cells(COLUMNS), format_record)


CSV_FORMATS = {
    "standard": _make_csv_format(),
    "excel": _make_csv_format(has_bom=True),
    "decimal-comma": _make_csv_format(delimiter=";", decimal=",", has_bom=True),
}
"""Dialects of CSV: for R and Python; for Excel where decimals have a point; where they have a comma."""

JSON_LINES = TableFormat("", lambda record: json.dumps(record.to_values(), ensure_ascii=True) + "\n")
"""One JSON object per record and line."""


@dataclass(frozen=True)
class RecordTable:
    """A file of records."""

    path: Path
    format: TableFormat

    def rewrite(self, records: Iterable[LeafRecord]) -> None:
        """Write the file anew, atomically. Raises InputError where it cannot be written."""
        with atomic_write(self.path) as temporary, temporary.open("wb") as file:
            file.write(_encode(self.format.header))
            for record in records:
                file.write(_encode(self.format.format_record(record)))

    def append(self, records: Iterable[LeafRecord]) -> None:
        """Append `records` to the file, all or none. Raises InputError where it cannot be written."""
        append_bytes(self.path, _encode("".join(map(self.format.format_record, records))))


def _encode(text: str) -> bytes:
    # The name of a file can hold bytes that are no text.
    return text.encode("utf-8", errors="replace")
