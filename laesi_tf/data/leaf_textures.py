"""Photographs of leaves as relief that scenes lay over a synthetic leaf's colour.

What is kept of a photograph is how its skin departs from its own mean: veins, pores and blotches. Its colour
and the light it was taken in are divided out, since a scene brings its own of both.
"""

import itertools
import warnings
from pathlib import Path

import cv2
import numpy as np

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import PHOTO_SUFFIXES, decode_photo
from laesi_tf.data.prefetch import prefetch

# Beyond these a picture shows a hole or a glint rather than skin.
DARKEST, BRIGHTEST = 0.4, 1.8
_SMALLEST_PX = 64
_SEARCH_PX = 512


def load_textures(folder: Path | str, *, side: int = 256, limit: int = 256) -> np.ndarray:
    """Reliefs float32 [N, side, side, 3] around mean 1 from the first `limit` photos in `folder`, by name.

    A leaf should fill the picture or lie on a ground that is paler in colour; the largest upright square
    within it is used. A photo that cannot be read or shows no leaf is named in a warning and skipped. Raises
    InputError for a folder that is missing or has no photo that can be used.
    """
    folder = Path(folder)
    results = list(
        prefetch(lambda path: _extract_relief(decode_photo(path), path, side), _list_photos(folder, limit))
    )
    bad = [result for _, result in results if isinstance(result, InputError)]
    reliefs = [result for _, result in results if not isinstance(result, InputError)]
    if not reliefs:
        raise InputError(f"none of the {len(bad)} photos in {folder} can be used; first: {bad[0]}")
    for error in bad:
        warnings.warn(f"texture skipped: {error}", stacklevel=2)
    return np.stack(reliefs)


def _list_photos(folder: Path, limit: int) -> list[Path]:
    try:
        found = sorted(path for path in folder.iterdir() if path.suffix.lower() in PHOTO_SUFFIXES)
    except OSError as error:
        raise InputError(f"cannot read textures from {folder}: {error.strerror}; name a folder") from None
    if not found:
        raise InputError(f"there are no photos in {folder}; put photographs of leaves there")
    return list(itertools.islice(found, limit))


def _extract_relief(image: np.ndarray, path: Path, side: int) -> np.ndarray:
    """Relief float32 [side, side, 3] of the leaf on `image`, uint8 [H, W, 3]; InputError without one."""
    top, left, length = _find_largest_leaf_square(image)
    if length < _SMALLEST_PX:
        raise InputError(
            f"{path} shows no leaf {_SMALLEST_PX} pixels across; crop it so that a leaf fills the picture"
        )
    square = image[top : top + length, left : left + length].astype(np.float32) / 255
    shrink = cv2.INTER_AREA if length > side else cv2.INTER_LINEAR
    skin = cv2.resize(square, (side, side), interpolation=shrink)
    # Light falls on all channels alike, so what the channels differ in is the leaf's own and stays.
    luma = skin @ np.array([0.299, 0.587, 0.114], np.float32)
    light = cv2.GaussianBlur(luma, (0, 0), side / 8, borderType=cv2.BORDER_REFLECT)
    relief = skin / np.maximum(light, 0.02)[..., None]
    relief /= np.maximum(relief.mean(axis=(0, 1)), 1e-3)
    return np.clip(relief, DARKEST, BRIGHTEST)


def _find_largest_leaf_square(image: np.ndarray) -> tuple[int, int, int]:
    """Top, left and side in pixels of the largest upright square of leaf on `image` [H, W, 3]."""
    scale = min(1.0, _SEARCH_PX / max(image.shape[:2]))
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    leaf = np.pad(_segment_leaf_by_colour(small).astype(np.uint8), 1)
    # In the chessboard metric the farthest point from all background is the largest square's middle.
    reach = cv2.distanceTransform(leaf, cv2.DIST_C, 3)
    row, column = np.unravel_index(np.argmax(reach), reach.shape)
    half = max(0, int(reach[row, column]) - 1)
    corner = (int(row) - 1 - half, int(column) - 1 - half)
    top, left = (max(0, int(place / scale)) for place in corner)
    return top, left, min(int((2 * half + 1) / scale), image.shape[0] - top, image.shape[1] - left)


def _segment_leaf_by_colour(image: np.ndarray) -> np.ndarray:
    """bool [H, W]: of a hue from red over yellow to green, and more saturated than what it lies on."""
    hue, saturation, value = cv2.split(cv2.cvtColor(image, cv2.COLOR_RGB2HSV))
    plausible = (hue < 90) | (hue > 165)
    like = (plausible & (saturation > _saturation_threshold(saturation)) & (value > 25)).astype(np.uint8)
    # Pores, veins and glints do not part a leaf.
    return cv2.morphologyEx(like, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8)) > 0


def _saturation_threshold(saturation: np.ndarray) -> float:
    """Saturation 0..255 that tells leaf from ground: between the two where they are apart, else low."""
    between, _ = cv2.threshold(saturation, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    high = saturation > between
    apart = 0 < high.mean() < 1 and saturation[high].mean() - saturation[~high].mean() > 50
    return max(40.0, between) if apart else 40.0
