"""The protocol of all estimators, what they are given and what they return.

An estimator measures the leaves on one upright photo at full resolution, or refuses with a reason. It gets
one photo at a time: photos differ in size, and a measurement must not depend on the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from laesi_tf.common.arrays import Mask, Points, RgbImage
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera


@dataclass(frozen=True, kw_only=True)
class PhotoInfo:
    """What is known about a photo before it is measured; an estimator that measures it itself ignores it."""

    px_per_mm: float | None = None
    """Scale at the leaf's area centroid, such as a scanner's resolution."""
    grid_mm: float | None = None
    """Distance between the finest lines of the paper; None where the lines shall say it."""


UNKNOWN = PhotoInfo()
"""Nothing is known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafMeasurement:
    """One leaf; None stands for what the estimator does not measure."""

    area_cm2: float | None = None
    """Flat one-sided area, holes subtracted, petiole included."""
    uncertainty_cm2: float | None = None
    """Standard deviation of `area_cm2`."""
    px_per_mm: float | None = None
    """Scale of the sheet at the leaf's area centroid."""
    length_mm: float | None = None
    """Longest extent along the leaf's main axis, petiole included."""
    width_mm: float | None = None
    """Largest extent across the main axis."""
    perimeter_mm: float | None = None
    """Length of the outer contour."""
    holes_cm2: float | None = None
    """Area of the holes, which `area_cm2` does not contain."""
    outline: Points | None = None
    """[N, 2] outer contour, points (x, y) in photo pixels, see `common.geometry`."""
    holes: tuple[Points, ...] = ()
    """The contours [n, 2] of the holes."""
    note: str | None = None
    """A reason to doubt the area of this leaf, such as that the photo cuts it off."""

    @property
    def rings(self) -> tuple[Points, ...]:
        """The outer contour and those of the holes; none without an outline."""
        return () if self.outline is None else (self.outline, *self.holes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """The result for one photo: an area for each leaf, or a refusal and no area at all.

    Leaves are in reading order, row by row. A refused measurement may still hold leaves, with outlines but
    without areas.
    """

    method: str
    """How it was measured, for people: `regression`, `mask x given scale`."""
    leaves: tuple[LeafMeasurement, ...] = ()
    mask: Mask | None = None
    """bool [H, W] at the photo's size, True on any leaf; None from an estimator without masks."""
    camera: SheetCamera | None = None
    """Maps between photo pixels and the printed lines; None if no ruling was read."""
    tilt_deg: float | None = None
    """Angle between the optical axis and the sheet's normal; None if not found."""
    note: str | None = None
    """A reason to doubt all areas, such as a low confidence in the ruling."""
    refusal: str | None = None
    """Why there is no area and what would help, or None."""

    @property
    def area_cm2(self) -> float | None:
        """Area of all leaves together; None when refused."""
        areas = [leaf.area_cm2 for leaf in self.leaves if leaf.area_cm2 is not None]
        return sum(areas) if areas and self.refusal is None else None

    @property
    def uncertainty_cm2(self) -> float | None:
        """Standard deviation of `area_cm2`; None where that of a leaf is unknown."""
        if self.area_cm2 is None:
            return None
        return sum_uncertainties([leaf.uncertainty_cm2 for leaf in self.leaves])


class Estimator(Protocol):
    """A way to measure leaves on a photo."""

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure the leaves on `image`, uint8 [H, W, 3] RGB, upright, of any size.

        The same image gives the same measurement, independent of earlier ones; `image` is not changed. An
        image that cannot be measured is refused in the result, not by an exception.
        """
        ...


def sum_uncertainties(uncertainties: Sequence[float | None]) -> float | None:
    """Return the uncertainty of a sum of areas; None where one is unknown.

    Uncertainties are added: an error of the scale is an error of all leaves.
    """
    known = [value for value in uncertainties if value is not None]
    return sum(known) if len(known) == len(uncertainties) else None


def sort_in_reading_order(boxes: Points) -> list[int]:
    """Return the indices of `boxes` [N, 2, 2], corners (x, y), by rows from the top and from left to right.

    A box belongs to a row if its middle is not below the bottom of the row's first box.
    """
    waiting = sorted(range(len(boxes)), key=lambda index: float(boxes[index, :, 1].mean()))
    order: list[int] = []
    while waiting:
        bottom = max(boxes[waiting[0], :, 1])
        row = [index for index in waiting if boxes[index, :, 1].mean() <= bottom]
        order += sorted(row, key=lambda index: float(boxes[index, :, 0].mean()))
        waiting = [index for index in waiting if index not in row]
    return order
