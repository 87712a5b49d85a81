"""The camera between a photo and its sheet of paper: homography, radial distortion and bend, in NumPy."""

import math
from dataclasses import dataclass, field

import numpy as np

from laesi_tf.common.sheet_model import FOCAL, SheetModel, line_density, to_lines
from laesi_tf.estimators.ruling.camera_ops import measure_scale_error, measure_tilt
from laesi_tf.estimators.ruling.scale_error import ScaleErrorParams

_DIFFERENCE = 1e-4
"""Step of numerical derivatives, in half the photo's longer side."""
_CONVERGED = 1e-10
"""Last step of Newton's method, in the same unit."""


@dataclass(frozen=True, eq=False)
class SheetCamera:
    """Maps between photo pixels, (x, y) with pixel centres at halves, and sheet millimetres.

    Sheet coordinates are millimetres along the two families of lines; whole multiples of `pitch_mm` are on
    printed lines.
    """

    parameters: np.ndarray
    """[14], as in `SheetModel`, in periods of the finest lines."""
    covariance: np.ndarray
    """[14, 14]."""
    size: tuple[int, int]
    """Height and width, in frame pixels, of the photo, or the part of it, as it was fitted."""
    step: tuple[float, float] = (1.0, 1.0)
    """Photo pixels per frame pixel, (x, y)."""
    pitch_mm: float = 1.0
    """Distance of the finest lines."""
    phase_error: float = 0.0
    """Median distance of the printed lines from the fit, periods."""
    error_params: ScaleErrorParams = field(default_factory=ScaleErrorParams)
    origin: tuple[float, float] = (0.0, 0.0)
    """Upper left corner (x, y) of the fitted part, photo pixels."""
    focal: float = FOCAL
    """Focal length in units of the fitted part's longer side."""

    def to_sheet(self, points: np.ndarray) -> np.ndarray:
        """Return the sheet millimetres [..., 2] of photo `points` [..., 2]."""
        return self.pitch_mm * self._lines(self.parameters, self._normalise(points))

    def to_photo(self, points: np.ndarray) -> np.ndarray:
        """Return photo pixels [..., 2] of sheet `points` [..., 2], mm, by Newton's method on `to_sheet`."""
        target = np.asarray(points, float) / self.pitch_mm
        place = self._undistorted_inverse(target)
        for _ in range(12):
            jacobian = self._jacobian(self.parameters, place)
            miss = target - self._lines(self.parameters, place)
            change = np.linalg.solve(jacobian, miss[..., None])[..., 0]
            place = place + np.clip(change, -0.3, 0.3)
            if np.abs(change).max(initial=0.0) < _CONVERGED:
                break
        unit, middle = self._frame()
        return (place * unit + middle) * self.step + self.origin

    def mm2_per_px(self, points: np.ndarray) -> np.ndarray:
        """Return the square millimetres of the sheet under a pixel at photo `points` [..., 2]."""
        unit, _ = self._frame()
        place = self._normalise(points)
        model = SheetModel(*self.parameters.astype(float))
        density = np.abs(line_density(model, place[..., 0], place[..., 1])) / unit**2
        return density * self.pitch_mm**2 / (self.step[0] * self.step[1])

    def px_per_mm(self, point: np.ndarray) -> float:
        """Return the scale at a photo `point` [2]: geometric mean over directions."""
        return float(1 / np.sqrt(self.mm2_per_px(point)))

    def distance_mm(self, point: np.ndarray) -> float:
        """Return the camera's distance from the sheet at a photo `point` [2], with a typical focal length."""
        focal_px = self.focal * max(self.size) * math.sqrt(self.step[0] * self.step[1])
        return focal_px / self.px_per_mm(point)

    def scale_error(self, point: np.ndarray) -> float:
        """Return the relative standard deviation of `px_per_mm` at a photo `point` [2]."""
        place = self._normalise(point)
        return float(
            measure_scale_error(
                self.parameters, self.covariance, self.phase_error, place, self.error_params, np
            )
        )

    def tilt_deg(self) -> float:
        """Return the angle in degrees between the line of sight and the paper's normal at the middle of the
        fitted part, see `measure_tilt`."""
        return float(measure_tilt(self.parameters, np, self.focal))

    def _frame(self) -> tuple[float, np.ndarray]:
        height, width = self.size
        return max(height, width) / 2, np.array([width / 2, height / 2])

    def _normalise(self, points: np.ndarray) -> np.ndarray:
        unit, middle = self._frame()
        return ((np.asarray(points, float) - self.origin) / self.step - middle) / unit

    @staticmethod
    def _lines(parameters: np.ndarray, place: np.ndarray) -> np.ndarray:
        model = SheetModel(*parameters.astype(float))
        return np.stack(to_lines(model, place[..., 0], place[..., 1]), -1)

    def _jacobian(self, parameters: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return [..., 2, 2], rows: gradients of both sheet coordinates by normalised place [..., 2]."""
        steps = np.eye(2) * _DIFFERENCE
        columns = [
            (self._lines(parameters, place + step) - self._lines(parameters, place - step))
            / (2 * _DIFFERENCE)
            for step in steps
        ]
        return np.stack(columns, -1)

    def _undistorted_inverse(self, lines: np.ndarray) -> np.ndarray:
        """Return normalised places [..., 2] of sheet coordinates in periods, by the homography alone."""
        m = SheetModel(*self.parameters.astype(float))
        u, v = lines[..., 0] - m.offset_u, lines[..., 1] - m.offset_v
        a, b = m.ux - u * m.tilt_x, m.uy - u * m.tilt_y
        c, d = m.vx - v * m.tilt_x, m.vy - v * m.tilt_y
        determinant = a * d - b * c
        return np.stack([(u * d - b * v) / determinant, (a * v - u * c) / determinant], -1)
