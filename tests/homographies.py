"""Points and scales through a homography, which scenes without lens and bend are compared with."""

import numpy as np


def apply_homography(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Map `points` [N, 2] through a homography [3, 3]: float64 [N, 2]."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def compute_px_per_mm(to_mm: np.ndarray, point: np.ndarray) -> float:
    """Return the scale at `point` [2] of a homography [3, 3] from pixels to millimetres.

    Where tilt makes the scale differ between directions it is their geometric mean, by the Jacobian's
    determinant.
    """
    w = point @ to_mm[2, :2] + to_mm[2, 2]
    return float(np.sqrt(abs(w) ** 3 / abs(np.linalg.det(to_mm))))
