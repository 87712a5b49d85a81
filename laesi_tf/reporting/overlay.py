"""Draw outlines and the millimetre grid on photos.

Images are uint8 [H, W, 3] RGB throughout, points as in `common.geometry`.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from laesi_tf.common.arrays import Homography, Points, RgbImage
from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.common.geometry import ImageSize, apply_homography, to_cv2_points

Colour = tuple[int, int, int]

# Neither leaves nor rulings nor common desks have these colours; both are visible on light and dark.
PREDICTED_COLOUR: Colour = (255, 0, 160)
TRUE_COLOUR: Colour = (0, 120, 255)
GRID_COLOUR: Colour = (0, 200, 255)

OVERLAY_SIDE_PX = 1600
"""Longer side of an overlay: leaf edges are visible, in a fifth of the bytes of a 12-megapixel photo."""
_MAX_LINES = 200
"""Grid lines in each direction."""
_SUBPIXEL_BITS = 4


def resize(image: RgbImage, side: int) -> RgbImage:
    """Return `image` [H, W, 3] with a longer side of `side` pixels."""
    scale = side / max(image.shape[:2])
    height, width = (max(1, round(length * scale)) for length in image.shape[:2])
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return cv2.resize(image, (width, height), interpolation=interpolation)


def draw_outlines(image: RgbImage, outlines: Sequence[tuple[Points, Colour]]) -> RgbImage:
    """Return `image` [H, W, 3] with closed `outlines`, points [N, 2] and colour each, on it."""
    drawn, thickness = image.copy(), max(1, max(image.shape[:2]) // 400)
    for outline, colour in outlines:
        points = to_cv2_points(outline, shift=_SUBPIXEL_BITS)
        cv2.polylines(drawn, [points], True, colour, thickness, cv2.LINE_AA, shift=_SUBPIXEL_BITS)
    return drawn


def draw_grid(image: RgbImage, to_mm: Homography, *, step_mm: float = 10.0) -> RgbImage:
    """Return `image` [H, W, 3] with a square grid of the sheet on it, in perspective.

    `to_mm` [3, 3] maps pixels to mm on the sheet, up to a translation: lines are parallel to the ruling but
    need not lie on its lines.
    """
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * ImageSize.of(image).xy
    on_sheet = apply_homography(to_mm, corners)
    box = np.stack([on_sheet.min(axis=0), on_sheet.max(axis=0)])
    to_px = np.linalg.inv(to_mm).astype(np.float64)
    drawn, thickness = image.copy(), max(1, max(image.shape[:2]) // 900)
    for axis in (0, 1):
        for position in np.arange(box[0, axis], box[1, axis], step_mm)[:_MAX_LINES]:
            ends = box.copy()
            ends[:, axis] = position
            start, end = to_cv2_points(apply_homography(to_px, ends)).tolist()
            cv2.line(drawn, start, end, GRID_COLOUR, thickness, cv2.LINE_AA)
    return drawn


def write_png(path: Path, image: RgbImage) -> None:
    """Write `image` [H, W, 3] as PNG, atomically. Raises InputError where it cannot be written."""
    with atomic_write(path) as temporary:
        # Level 1 takes a third of the time of the default for a tenth more bytes.
        Image.fromarray(image).save(temporary, format="PNG", compress_level=1)
