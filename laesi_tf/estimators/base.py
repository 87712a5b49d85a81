"""The protocol of all estimators, what they are given and what they return.

An estimator measures the leaves on one upright photo at full resolution, or refuses with a reason. It gets
one photo at a time: photos differ in size, and a measurement must not depend on the others.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True, kw_only=True)
class PhotoInfo:
    """What is known about a photo before it is measured; an estimator that finds out by itself ignores it."""

    px_per_mm: float | None = None
    """Scale at the leaf's centroid, as with a scanner's resolution."""
    grid_mm: float = 1.0
    """Distance between the finest lines of the paper."""


UNKNOWN = PhotoInfo()


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafMeasurement:
    """One leaf; what an estimator does not find out is None."""

    area_cm2: float | None = None
    """Flat one-sided area, holes subtracted, petiole included."""
    uncertainty_cm2: float | None = None
    """Standard deviation of `area_cm2`."""
    px_per_mm: float | None = None
    """Scale at the leaf's centroid that the area rests on."""
    length_mm: float | None = None
    """Longest extent along the leaf's main axis, petiole included."""
    width_mm: float | None = None
    """Largest extent across the main axis."""
    perimeter_mm: float | None = None
    """Length of the outer margin."""
    holes_cm2: float | None = None
    """Area of the holes, which `area_cm2` leaves out."""
    outline: np.ndarray | None = None
    """[N, 2] outer contour as (x, y) in photo pixels, pixel centres at whole numbers."""
    holes: tuple[np.ndarray, ...] = ()
    """The contours of its holes in the same way."""
    note: str | None = None
    """What a user must know before believing the area: that the photo cuts the leaf off."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """What an estimator says about one photo: an area for each leaf, or a refusal and no area at all.

    Leaves come in reading order, row by row. A refused measurement may still hold leaves, with outlines but
    no areas.
    """

    method: str
    """How it was measured, for people: `regression`, `mask x given scale`."""
    leaves: tuple[LeafMeasurement, ...] = ()
    mask: np.ndarray | None = None
    """bool [H, W] at the photo's size, True on any leaf; None from an estimator that makes no masks."""
    to_mm: np.ndarray | None = None
    """Homography [3, 3] from photo pixels, their centres at halves, to mm on the sheet; None if not found."""
    tilt_deg: float | None = None
    """Angle between the camera's axis and the sheet's normal; None if not found."""
    note: str | None = None
    """What casts doubt on all areas: that the ruling was hard to read."""
    refusal: str | None = None
    """Why no area is given and what would help, or None."""

    @property
    def area_cm2(self) -> float | None:
        """Area of all leaves together; None when refused."""
        areas = [leaf.area_cm2 for leaf in self.leaves if leaf.area_cm2 is not None]
        return sum(areas) if areas and self.refusal is None else None


class Estimator(Protocol):
    """A way to measure leaves on a photo."""

    def measure(self, image: np.ndarray, known: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure the leaves on `image`, uint8 [H, W, 3] RGB, upright, of any size.

        The same image gives the same measurement, whatever was measured before; `image` is not changed. An
        image that cannot be measured is refused in the result, not by an exception.
        """
        ...


def sort_in_reading_order(boxes: np.ndarray) -> list[int]:
    """Indices of `boxes` [N, 2, 2], (x, y) of their corners, row by row from the top, each from the left.

    A box whose middle lies within the height of a row's first box belongs to that row.
    """
    waiting = sorted(range(len(boxes)), key=lambda index: float(boxes[index, :, 1].mean()))
    order: list[int] = []
    while waiting:
        bottom = max(boxes[waiting[0], :, 1])
        row = [index for index in waiting if boxes[index, :, 1].mean() <= bottom]
        order += sorted(row, key=lambda index: float(boxes[index, :, 0].mean()))
        waiting = [index for index in waiting if index not in row]
    return order
