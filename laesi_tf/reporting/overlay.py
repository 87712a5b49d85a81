"""Draw outlines and the lines of the ruling on photos.

Images are uint8 [H, W, 3] RGB throughout, points as in `common.geometry`.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from laesi_tf.common.arrays import Points, RgbImage
from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.common.geometry import ImageSize, to_cv2_points
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera

Colour = tuple[int, int, int]

# Neither leaves nor rulings nor common desks have these colours; both are visible on light and dark.
PREDICTED_COLOUR: Colour = (255, 0, 160)
TRUE_COLOUR: Colour = (0, 120, 255)
GRID_COLOUR: Colour = (0, 200, 255)

_MAX_LINES = 200
"""Grid lines in each direction."""
_POINTS_PER_LINE = 33
"""A line that a lens bends is drawn through so many points."""
_SUBPIXEL_BITS = 4
_JPEG_QUALITY = 88


def resize(image: RgbImage, side: int) -> RgbImage:
    """Return `image` [H, W, 3] with a longer side of `side` pixels."""
    scale = side / max(image.shape[:2])
    height, width = (max(1, round(length * scale)) for length in image.shape[:2])
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    # A thumbnail of a large photo is averaged over sixteen to 64 of its pixels each.
    skipped = max(1, int(1 / (4 * scale)))
    image = image[::skipped, ::skipped]
    return cv2.resize(image, (width, height), interpolation=interpolation)


def draw_outlines(image: RgbImage, outlines: Sequence[tuple[Points, Colour]]) -> RgbImage:
    """Return `image` [H, W, 3] with closed `outlines`, points [N, 2] and colour each, on it."""
    drawn, thickness = image.copy(), max(1, max(image.shape[:2]) // 400)
    for outline, colour in outlines:
        points = to_cv2_points(outline, shift=_SUBPIXEL_BITS)
        cv2.polylines(drawn, [points], True, colour, thickness, cv2.LINE_AA, shift=_SUBPIXEL_BITS)
    return drawn


def draw_grid(image: RgbImage, camera: SheetCamera, *, scale: Points | float = 1.0) -> RgbImage:
    """Return `image` [H, W, 3] with every tenth printed line of the sheet on it, as the camera sees them.

    `scale` are the pixels of `image` per pixel of the photo that `camera` maps. Whoever looks can check that
    the drawn lines lie on printed ones.
    """
    size = ImageSize.of(image).xy / scale
    along = np.linspace(0, 1, _POINTS_PER_LINE)
    border = np.concatenate([[[t, 0], [t, 1], [0, t], [1, t]] for t in along]) * size
    on_sheet = camera.to_sheet(border)
    on_sheet = on_sheet[np.isfinite(on_sheet).all(axis=1)]
    low, high = on_sheet.min(axis=0), on_sheet.max(axis=0)
    step = 10 * camera.pitch_mm
    drawn, thickness = image.copy(), max(1, max(image.shape[:2]) // 900)
    for axis in (0, 1):
        first, last = np.ceil(low[axis] / step), np.floor(high[axis] / step)
        numbers = np.arange(first, min(last, first + _MAX_LINES) + 1)
        lines = np.tile(low + along[:, None] * (high - low), (len(numbers), 1, 1))
        lines[..., axis] = numbers[:, None] * step
        pieces = [piece for points in camera.to_photo(lines) for piece in _find_visible(points, size)]
        polylines = [to_cv2_points(piece * scale, shift=_SUBPIXEL_BITS) for piece in pieces]
        cv2.polylines(drawn, polylines, False, GRID_COLOUR, thickness, cv2.LINE_AA, shift=_SUBPIXEL_BITS)
    return drawn


def _find_visible(line: Points, size: Points) -> list[Points]:
    """Return the pieces of `line` [N, 2] that lie on a photo of `size` (x, y) or close to it."""
    inside = ((line > -size) & (line < 2 * size)).all(axis=1)
    changes = np.flatnonzero(np.diff(inside, prepend=False, append=False))
    return [line[start:end] for start, end in zip(changes[::2], changes[1::2], strict=True)]


def write_png(path: Path, image: RgbImage) -> None:
    """Write `image` [H, W, 3] as PNG, atomically. Raises InputError where it cannot be written."""
    with atomic_write(path) as temporary:
        # Level 1 takes a third of the time of the default for a tenth more bytes.
        Image.fromarray(image).save(temporary, format="PNG", compress_level=1)


def write_jpeg(path: Path, image: RgbImage) -> None:
    """Write `image` [H, W, 3] as JPEG, atomically. Raises InputError where it cannot be written."""
    with atomic_write(path) as temporary:
        # Thin coloured lines need all of the resolution of colour.
        Image.fromarray(image).save(temporary, format="JPEG", quality=_JPEG_QUALITY, subsampling=0)
