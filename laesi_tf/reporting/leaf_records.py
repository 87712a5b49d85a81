"""The table of measured leaves: one record per leaf, or per photo without a measured leaf."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.common.atomic_files import write_csv, write_json
from laesi_tf.common.text import round_for_table
from laesi_tf.estimators.base import Measurement

_COLUMNS = (
    *("photo", "leaf", "area_cm2", "uncertainty_cm2", "px_per_mm", "length_mm", "width_mm", "perimeter_mm"),
    *("holes_cm2", "tilt_deg", "method", "refused", "note", "error"),
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LeafRecord:
    """One leaf, or one photo on which no leaf was measured; the measures are those of `LeafMeasurement`."""

    photo: str
    leaf: int | None = None
    """Number of the leaf on its photo, from 1 in reading order."""
    area_cm2: float | None = None
    uncertainty_cm2: float | None = None
    px_per_mm: float | None = None
    length_mm: float | None = None
    width_mm: float | None = None
    perimeter_mm: float | None = None
    holes_cm2: float | None = None
    tilt_deg: float | None = None
    method: str | None = None
    refused: bool = False
    """Whether the photo could be read but the estimator refused it."""
    note: str | None = None
    """A reason to doubt the area."""
    error: str | None = None
    """Why there is no area: the file cannot be read, or the estimator's refusal."""
    overlay: str | None = None
    """Name of the overlay's file; None where the photo cannot be read."""


def make_records(photo: str, measurement: Measurement, overlay: str) -> list[LeafRecord]:
    """Return the records of one photo, numbers with five significant digits."""
    if measurement.refusal is not None:
        return [
            LeafRecord(
                photo=photo,
                method=measurement.method,
                refused=True,
                error=measurement.refusal,
                overlay=overlay,
            )
        ]
    return [
        LeafRecord(
            photo=photo,
            leaf=number,
            tilt_deg=round_for_table(measurement.tilt_deg),
            method=measurement.method,
            note="; ".join(filter(None, [leaf.note, measurement.note])) or None,
            overlay=overlay,
            area_cm2=round_for_table(leaf.area_cm2),
            uncertainty_cm2=round_for_table(leaf.uncertainty_cm2),
            px_per_mm=round_for_table(leaf.px_per_mm),
            length_mm=round_for_table(leaf.length_mm),
            width_mm=round_for_table(leaf.width_mm),
            perimeter_mm=round_for_table(leaf.perimeter_mm),
            holes_cm2=round_for_table(leaf.holes_cm2),
        )
        for number, leaf in enumerate(measurement.leaves, 1)
    ]


def write_records(records: Sequence[LeafRecord], *, table: Path, json: Path | None) -> None:
    """Write `records` as the CSV file `table` and, without the overlays, as JSON. Raises InputError."""
    header = [*_COLUMNS, "overlay"]
    write_csv(table, header, ([getattr(record, column) for column in header] for record in records))
    if json is not None:
        write_json(json, [{column: getattr(record, column) for column in _COLUMNS} for record in records])
