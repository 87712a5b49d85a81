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
