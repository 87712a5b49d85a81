"""Extract the relief of leaf photos, which scenes multiply with a synthetic leaf's colour.

A relief is the photo divided by its own smooth light and mean colour: veins, pores and blotches remain. A
scene brings its own light and colour.
"""

import itertools
import warnings
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import decode_photo
from laesi_tf.data.file_formats import PHOTO_SUFFIXES
from laesi_tf.data.prefetch import prefetch

# Values outside show a hole or a reflection rather than leaf surface.
DARKEST, BRIGHTEST = 0.4, 1.8
_MIN_SIDE_PX = 64
_SEARCH_PX = 512


def load_textures(folder: Path | str, *, side: int = 256, limit: int = 256) -> NDArray[np.float32]:
    """Extract reliefs float32 [N, side, side, 3] of mean 1 from the first `limit` photos in `folder`.

    A leaf should fill the photo or lie on a background of paler colour; the largest upright square within it
    is used. A photo that cannot be read or shows no leaf is skipped with a warning. Raises InputError for a
    folder that is missing or has no usable photo.
    """
    folder = Path(folder)
    results = list(
        prefetch(lambda path: _extract_relief(decode_photo(path), path, side), _list_photos(folder, limit))
    )
    errors = [result for _, result in results if isinstance(result, InputError)]
    reliefs = [result for _, result in results if not isinstance(result, InputError)]
    if not reliefs:
        raise InputError(f"none of the {len(errors)} photos in {folder} can be used; first: {errors[0]}")
    for error in errors:
        warnings.warn(f"texture skipped: {error}", stacklevel=2)
    return np.stack(reliefs)


def _list_photos(folder: Path, limit: int) -> list[Path]:
    try:
        photos = sorted(path for path in folder.iterdir() if path.suffix.lower() in PHOTO_SUFFIXES)
    except OSError as error:
        raise InputError(f"cannot read textures from {folder}: {error.strerror}; name a folder") from None
    if not photos:
        raise InputError(f"there are no photos in {folder}; put photos of leaves there")
    return list(itertools.islice(photos, limit))


def _extract_relief(image: NDArray[np.uint8], path: Path, side: int) -> NDArray[np.float32]:
    """Extract the relief float32 [side, side, 3] of the leaf on `image` [H, W, 3]. Raises InputError."""
    top, left, length = _find_largest_leaf_square(image)
    if length < _MIN_SIDE_PX:
        raise InputError(
            f"{path} shows no leaf {_MIN_SIDE_PX} pixels across; crop it so that a leaf fills the photo"
        )
    square = image[top : top + length, left : left + length].astype(np.float32) / 255
    interpolation = cv2.INTER_AREA if length > side else cv2.INTER_LINEAR
    surface = cv2.resize(square, (side, side), interpolation=interpolation)
    # Light is the same in all channels, so what the channels differ in belongs to the leaf and stays.
    luma = surface @ np.array([0.299, 0.587, 0.114], np.float32)
    light = cv2.GaussianBlur(luma, (0, 0), side / 8, borderType=cv2.BORDER_REFLECT)
    relief = surface / np.maximum(light, 0.02)[..., None]
    relief /= np.maximum(relief.mean(axis=(0, 1)), 1e-3)
    return np.clip(relief, DARKEST, BRIGHTEST)


def _find_largest_leaf_square(image: NDArray[np.uint8]) -> tuple[int, int, int]:
    """Return top, left and side in pixels of the largest upright square of leaf on `image` [H, W, 3]."""
    scale = min(1.0, _SEARCH_PX / max(image.shape[:2]))
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    is_leaf = np.pad(_segment_leaf_by_colour(small).astype(np.uint8), 1)
    # In the chessboard metric, the pixel farthest from the background is the centre of the largest square.
    distance = cv2.distanceTransform(is_leaf, cv2.DIST_C, 3)
    row, column = np.unravel_index(np.argmax(distance), distance.shape)
    half = max(0, int(distance[row, column]) - 1)
    corner = (int(row) - 1 - half, int(column) - 1 - half)
    top, left = (max(0, int(position / scale)) for position in corner)
    return top, left, min(int((2 * half + 1) / scale), image.shape[0] - top, image.shape[1] - left)


def _segment_leaf_by_colour(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return bool [H, W]: hue between red and green, and more saturated than the background."""
    hue, saturation, value = cv2.split(cv2.cvtColor(image, cv2.COLOR_RGB2HSV))
    has_leaf_hue = (hue < 90) | (hue > 165)
    is_saturated = saturation > _saturation_threshold(saturation)
    is_leaf = (has_leaf_hue & is_saturated & (value > 25)).astype(np.uint8)
    # Close pores, veins and reflections.
    return cv2.morphologyEx(is_leaf, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8)) > 0


def _saturation_threshold(saturation: NDArray[np.uint8]) -> float:
    """Return the saturation 0..255 that separates leaf from background, 40 if they do not differ."""
    otsu, _ = cv2.threshold(saturation, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    high = saturation > otsu
    is_bimodal = 0 < high.mean() < 1 and saturation[high].mean() - saturation[~high].mean() > 50
    return max(40.0, otsu) if is_bimodal else 40.0
