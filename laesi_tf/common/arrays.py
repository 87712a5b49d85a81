"""Types of the NumPy arrays that packages pass to one another."""

import numpy as np
from numpy.typing import NDArray

RgbImage = NDArray[np.uint8]
"""[H, W, 3] RGB, 0..255."""
Mask = NDArray[np.bool_]
"""[H, W], True where there is leaf."""
FloatMap = NDArray[np.float32]
"""[H, W], one number per pixel."""
Points = NDArray[np.float64]
"""[N, 2] or [2], (x, y) as in `common.geometry`."""
