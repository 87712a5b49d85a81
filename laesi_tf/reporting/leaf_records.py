"""The records of a photo: one for each measured leaf, or one for a photo without a measured leaf."""

import dataclasses
from typing import Any

from laesi_tf.common.text import round_for_table
from laesi_tf.estimators.base import Measurement

_DIGITS = 4
"""Significant digits of a measure: no photo gives an area to better than 0.1 %."""
_UNCERTAINTY_DIGITS = 2
"""Significant digits of its standard deviation."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LeafRecord:
    """One leaf, or one photo on which no leaf was measured; the measures are those of `LeafMeasurement`."""

    photo: str
    sample: str | None = None
    """Name of the sample, from --names."""
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
    """Name of the overlay's file; None where there is none."""

    @property
    def is_unreadable(self) -> bool:
        """Whether the photo could not be read."""
        return self.error is not None and not self.refused

    def to_values(self) -> dict[str, Any]:
        """Return the columns of the table by name."""
        return {name: getattr(self, name) for name in COLUMNS}


COLUMNS = tuple(field.name for field in dataclasses.fields(LeafRecord))
"""The columns of the table."""


def make_records(photo: str, measurement: Measurement, overlay: str | None) -> list[LeafRecord]:
    """Return the records of one photo, numbers with four significant digits, uncertainties with two.

    The tilt has one decimal.
    """
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
            tilt_deg=None if measurement.tilt_deg is None else round(measurement.tilt_deg, 1),
            method=measurement.method,
            note="; ".join(filter(None, [leaf.note, measurement.note])) or None,
            overlay=overlay,
            area_cm2=round_for_table(leaf.area_cm2, _DIGITS),
            uncertainty_cm2=round_for_table(leaf.uncertainty_cm2, _UNCERTAINTY_DIGITS),
            px_per_mm=round_for_table(leaf.px_per_mm, _DIGITS),
            length_mm=round_for_table(leaf.length_mm, _DIGITS),
            width_mm=round_for_table(leaf.width_mm, _DIGITS),
            perimeter_mm=round_for_table(leaf.perimeter_mm, _DIGITS),
            holes_cm2=round_for_table(leaf.holes_cm2, _DIGITS),
        )
        for number, leaf in enumerate(measurement.leaves, 1)
    ]
