"""The map from a photo to the printed lines: radial distortion, the lowest-order bend, a homography.

Written with plain arithmetic, so that the same formula serves the rendered scenes, TensorFlow's fit and
NumPy's camera.
"""

from typing import Any, NamedTuple

FOCAL = 0.78
"""Focal length of a phone's main camera in units of the photo's longer side: 28 mm on 36 mm."""
FOCAL_SQUARED = (2 * FOCAL) ** 2
"""Its square in units of half the photo's longer side. It only says towards which point paper that rises from
its plane moves in the photo."""


class SheetModel(NamedTuple):
    """Parameters; each is a number or an array that broadcasts with the points.

    Points are (x, y) in units of half the photo's longer side from the photo's middle.
    """

    offset_u: Any
    offset_v: Any
    ux: Any
    uy: Any
    vx: Any
    vy: Any
    tilt_x: Any
    tilt_y: Any
    k1: Any
    centre_x: Any
    centre_y: Any
    bend_xx: Any
    bend_xy: Any
    bend_yy: Any


COUNT = len(SheetModel._fields)


def to_lines(model: SheetModel, x: Any, y: Any) -> tuple[Any, Any]:
    """Sheet coordinates (u, v) of the points, in periods of the printed lines: lines lie at whole numbers."""
    x, y = remove_bend(model, *remove_distortion(model, x, y))
    depth = 1 + model.tilt_x * x + model.tilt_y * y
    u = (model.ux * x + model.uy * y) / depth + model.offset_u
    v = (model.vx * x + model.vy * y) / depth + model.offset_v
    return u, v


def remove_distortion(model: SheetModel, x: Any, y: Any) -> tuple[Any, Any]:
    """Points freed of radial distortion about `centre`; with k1 > 0 the photo is barrel-shaped."""
    dx, dy = x - model.centre_x, y - model.centre_y
    stretch = model.k1 * (dx * dx + dy * dy)
    return x + dx * stretch, y + dy * stretch


def remove_bend(model: SheetModel, x: Any, y: Any) -> tuple[Any, Any]:
    """Undistorted points as they would be on a flat sheet.

    Paper that rises by z (quadratic in the place) moves away from the point below the camera.
    """
    rise = model.bend_xx * x * x + model.bend_xy * x * y + model.bend_yy * y * y
    return x + rise * (x - FOCAL_SQUARED * model.tilt_x), y + rise * (y - FOCAL_SQUARED * model.tilt_y)


def line_density(model: SheetModel, x: Any, y: Any) -> Any:
    """Squares of one period by one period per unit of area at the points: the determinant of `to_lines`.

    Its sign tells whether the sheet is seen from its back. Analytic, as differences of coordinates of a
    hundred periods have too few digits in float32.
    """
    dx, dy = x - model.centre_x, y - model.centre_y
    stretch = model.k1 * (dx * dx + dy * dy)
    cross = 2 * model.k1 * dx * dy
    of_distortion = (1 + stretch + 2 * model.k1 * dx * dx) * (1 + stretch + 2 * model.k1 * dy * dy) - cross**2
    x, y = x + dx * stretch, y + dy * stretch
    rise = model.bend_xx * x * x + model.bend_xy * x * y + model.bend_yy * y * y
    rise_x, rise_y = 2 * model.bend_xx * x + model.bend_xy * y, model.bend_xy * x + 2 * model.bend_yy * y
    away_x, away_y = x - FOCAL_SQUARED * model.tilt_x, y - FOCAL_SQUARED * model.tilt_y
    of_bend = (1 + rise + rise_x * away_x) * (1 + rise + rise_y * away_y) - rise_x * rise_y * away_x * away_y
    x, y = x + rise * away_x, y + rise * away_y
    depth = 1 + model.tilt_x * x + model.tilt_y * y
    u, v = (model.ux * x + model.uy * y) / depth, (model.vx * x + model.vy * y) / depth
    of_tilt = (model.ux - u * model.tilt_x) * (model.vy - v * model.tilt_y)
    of_tilt = of_tilt - (model.uy - u * model.tilt_y) * (model.vx - v * model.tilt_x)
    return of_distortion * of_bend * of_tilt / (depth * depth)
