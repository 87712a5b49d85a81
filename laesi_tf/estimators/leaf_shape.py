"""Measure a leaf's polygon: area, holes, length, width and perimeter."""

from dataclasses import dataclass

import numpy as np

from laesi_tf.common.geometry import main_axis, polygon_area


@dataclass(frozen=True, kw_only=True)
class LeafShape:
    """Figures of one leaf in the unit of its outline; areas in its square."""

    area: float
    """Holes subtracted."""
    holes: float
    """Area of the holes together."""
    length: float
    """Extent along the main axis, that of the outline's second moments, petiole included."""
    width: float
    """Extent across the main axis."""
    perimeter: float
    """Of the outer margin."""


def measure_polygon(outline: np.ndarray, holes: tuple[np.ndarray, ...]) -> LeafShape:
    """Figures of the leaf within `outline` [N, 2] without its `holes`, [n, 2] each."""
    gaps = sum(abs(polygon_area(hole)) for hole in holes)
    axis = main_axis(outline)
    along, across = outline @ axis, outline @ [-axis[1], axis[0]]
    return LeafShape(
        area=abs(polygon_area(outline)) - gaps,
        holes=gaps,
        length=float(np.ptp(along)),
        width=float(np.ptp(across)),
        perimeter=float(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).sum()),
    )
