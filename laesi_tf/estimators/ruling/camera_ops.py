"""Scale, its error and tilt of a fitted sheet, once for NumPy and for TensorFlow.

Functions take the array namespace `xp` that they compute in: `numpy` for the camera of a photo, or
`tensorflow.experimental.numpy` within a graph. Places are (x, y) in units of half the photo's longer side
from the photo's middle, as in `SheetModel`.
"""

from typing import Any

import numpy as np

from laesi_tf.common.sheet_model import COUNT, FOCAL, SheetModel, line_density
from laesi_tf.estimators.ruling.scale_error import ScaleErrorParams

_FOCALS = 0.5 / FOCAL, 3.0 / FOCAL
"""Focal lengths that are believed, of the expected one: an ultra-wide camera, and a photo cropped to a
quarter."""


def unpack_sheet(parameters: Any) -> SheetModel:
    """Return the model of `parameters` [..., COUNT], each field [...]."""
    return SheetModel(*(parameters[..., index] for index in range(COUNT)))


def squares_per_area(parameters: Any, place: Any) -> Any:
    """Return how many squares of the finest lines a unit of area holds at `place` [..., 2].

    `parameters` are [COUNT] or have the axes of `place` before their last.
    """
    return abs(line_density(unpack_sheet(parameters), place[..., 0], place[..., 1]))


def measure_scale_error(
    parameters: Any,
    covariance: Any,
    phase_error: Any,
    place: Any,
    params: ScaleErrorParams,
    xp: Any,
) -> Any:
    """Return the relative standard deviation of the scale at `place` [..., 2].

    The fit's `covariance` [COUNT, COUNT], what paper that is not flat adds (`phase_error`, periods), and a
    floor.
    """
    identity = np.eye(COUNT, dtype=np.float32)
    variances = xp.sum(covariance * identity, -1)
    deviation = xp.sqrt(xp.maximum(variances, xp.zeros_like(variances)))
    shifts = identity * deviation
    model = unpack_sheet(xp.concatenate([parameters + shifts, parameters - shifts], 0))
    density = abs(line_density(model, place[..., 0, None], place[..., 1, None]))
    more, fewer = density[..., :COUNT], density[..., COUNT:]
    # Twice the relative difference is that of the logarithms, without their loss of digits.
    change = (more - fewer) / (more + fewer)
    known = deviation > 0
    gradient = xp.where(
        known, change / xp.where(known, deviation, xp.ones_like(deviation)), xp.zeros_like(change)
    )
    of_fit = xp.sum(gradient * (covariance @ gradient[..., None])[..., 0], -1) / 4
    of_fit = xp.maximum(of_fit, xp.zeros_like(of_fit))
    return xp.sqrt(of_fit + (params.waviness * phase_error) ** 2 + params.floor**2)


def measure_tilt(parameters: Any, xp: Any, focal: float = FOCAL) -> Any:
    """Return the angle in degrees between the camera's axis and the paper's normal at the photo's middle.

    `parameters` are [COUNT]; `focal` is the expected focal length in units of the photo's longer side.
    Assumes square pixels and the principal point in the middle. There the scales across and along the tilt
    are as 1 to cos(tilt), and the scale's relative change per pixel is tan(tilt) over the focal length. Where
    both together say a focal length that cameras have, the ratio is taken; else the change and the expected
    focal length.
    """
    sheet = unpack_sheet(parameters)
    # Singular values of a matrix of two rows: from the sum and the product of their squares.
    total = sheet.ux**2 + sheet.uy**2 + sheet.vx**2 + sheet.vy**2
    product = abs(sheet.ux * sheet.vy - sheet.uy * sheet.vx)
    spread = xp.sqrt(xp.maximum(total**2 - 4 * product**2, xp.zeros_like(total)))
    # The ratio of the smaller to the larger is the product over the square of the larger.
    cosine = xp.minimum(2 * product / (total + spread), xp.ones_like(total))
    sine = xp.sqrt(1 - cosine**2)
    change = xp.sqrt(sheet.tilt_x**2 + sheet.tilt_y**2) * (2 * focal)
    is_camera = (_FOCALS[0] * change * cosine <= sine) & (sine <= _FOCALS[1] * change * cosine)
    by_ratio, by_change = xp.arctan2(sine, cosine), xp.arctan2(change, xp.ones_like(change))
    return xp.where(is_camera, by_ratio, by_change) * (180 / np.pi)
