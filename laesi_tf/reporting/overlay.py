"""Draw outlines and the millimetre grid on photos.

Images are uint8 [H, W, 3] RGB throughout.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from laesi_tf.common.atomic_files import atomic_write

Colour = tuple[int, int, int]

# Neither colour is a leaf's, a ruling's or a common desk's; both hold on light and dark ground.
PREDICTED_COLOUR: Colour = (255, 0, 160)
TRUE_COLOUR: Colour = (0, 120, 255)
GRID_COLOUR: Colour = (0, 200, 255)
_MAX_LINES = 200

# Wide enough to see a margin on a screen, and a fifth of a 12-megapixel photo's bytes.
OVERLAY_SIDE_PX = 1600


def draw_outlines(
    image: np.ndarray, outlines: Sequence[tuple[np.ndarray, Colour]], *, side: int = OVERLAY_SIDE_PX
) -> np.ndarray:
    """`image` [H, W, 3] with its longer side brought to `side` pixels, and `outlines` on it.

    Each outline is [N, 2], (x, y) in the pixels of `image`.
    """
    scale = side / max(image.shape[:2])
    width, height = (max(1, round(length * scale)) for length in (image.shape[1], image.shape[0]))
    filter_ = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = cv2.resize(image, (width, height), interpolation=filter_)
    for outline, colour in outlines:
        # Sixteenths of a pixel; pixel centres move by half a pixel on scaling.
        points = np.round(((outline + 0.5) * scale - 0.5) * 16).astype(np.int32)
        cv2.polylines(picture, [points], True, colour, max(1, side // 400), cv2.LINE_AA, shift=4)
    return picture


def draw_grid(image: np.ndarray, to_mm: np.ndarray, *, step_mm: float = 10.0) -> np.ndarray:
    """`image` [H, W, 3] with a square lattice of the sheet over it: its lines run and fan out as the ruling.

    `to_mm` [3, 3] takes pixels, their centres at halves, to mm on the sheet, up to translation.
    """
    height, width = image.shape[:2]
    corners = _apply_homography(to_mm, np.array([[0, 0], [width, 0], [width, height], [0, height]]))
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    drawn, thickness = image.copy(), max(1, max(height, width) // 900)
    for axis in (0, 1):
        for place in np.arange(box[0, axis], box[1, axis], step_mm)[:_MAX_LINES]:
            ends = box.copy()
            ends[:, axis] = place
            start, end = np.round(_apply_homography(np.linalg.inv(to_mm), ends) - 0.5).astype(int).tolist()
            cv2.line(drawn, start, end, GRID_COLOUR, thickness, cv2.LINE_AA)
    return drawn


def _apply_homography(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """`points` [N, 2] through a homography [3, 3]."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return mapped[:, :2] / mapped[:, 2:]


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write `picture` [H, W, 3] as PNG, whole or not at all. Raises InputError where it cannot."""
    with atomic_write(path) as temporary:
        # Level 1 takes a third of the time of the default and a tenth more bytes.
        Image.fromarray(picture).save(temporary, format="PNG", compress_level=1)
