"""Measure a leaf's polygon: area, holes, length, width and perimeter.

The polygon is mapped to the sheet before anything is measured. A homography keeps straight lines straight,
and a lens bends no edge, which is about a pixel long, so the area of the mapped polygon is exact.
"""

from dataclasses import dataclass

import numpy as np

from laesi_tf.common.geometry import Polygon, polygon_area, polygon_main_axis, polygon_perimeter


@dataclass(frozen=True, kw_only=True)
class LeafShape:
    """Measures of one leaf in the unit of its polygon; areas in the unit's square."""

    area: float
    """Holes subtracted."""
    holes: float
    """Total area of the holes."""
    length: float
    """Extent along the main axis, petiole included."""
    width: float
    """Extent across the main axis."""
    perimeter: float
    """Length of the outer contour."""


def measure_polygon(polygon: Polygon) -> LeafShape:
    """Measure a leaf's outline and holes."""
    outer, holes = polygon
    holes_area = sum(abs(polygon_area(hole)) for hole in holes)
    axis = polygon_main_axis(outer)
    along, across = outer @ axis, outer @ np.array([-axis[1], axis[0]])
    return LeafShape(
        area=abs(polygon_area(outer)) - holes_area,
        holes=holes_area,
        length=float(np.ptp(along)),
        width=float(np.ptp(across)),
        perimeter=polygon_perimeter(outer),
    )
