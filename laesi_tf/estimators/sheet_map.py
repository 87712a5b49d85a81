"""What an outline needs to know of a scale: where photo points lie on the sheet, and how large pixels are."""

from dataclasses import dataclass
from typing import Protocol

from laesi_tf.common.arrays import Points


class SheetMap(Protocol):
    """A map from photo pixels to millimetres on the sheet."""

    def to_sheet(self, points: Points) -> Points:
        """Return the sheet points [..., 2] in mm of photo `points` [..., 2] in pixels."""
        ...

    def px_per_mm(self, point: Points) -> float:
        """Return the scale at a photo `point` [2], geometric mean over directions."""
        ...


@dataclass(frozen=True)
class UniformScale:
    """One scale for the whole photo, such as a scanner's."""

    scale_px_per_mm: float

    def to_sheet(self, points: Points) -> Points:
        """As `SheetMap.to_sheet`."""
        return points / self.scale_px_per_mm

    def px_per_mm(self, point: Points) -> float:
        """As `SheetMap.px_per_mm`; the same at every point."""
        del point
        return self.scale_px_per_mm
