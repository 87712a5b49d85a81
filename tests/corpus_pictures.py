"""What the files of tests/corpus show."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Pixels = NDArray[np.uint8]


def draw_picture() -> Pixels:
    """Return a picture, uint8 [32, 48, 3], which looks different in each orientation, up to 250 of 255."""
    rows, columns = np.mgrid[:32, :48]
    picture = np.stack([40 + columns * 4, 30 + rows * 5, 200 - rows * 2 - columns], axis=-1)
    picture[4:12, 6:20] = 250, 250, 245
    picture[20:28, 30:34] = 20, 90, 40
    return picture.astype(np.uint8)


def draw(shows: str) -> Pixels:
    """Return what a file shows, uint8 [32, 48, 3]."""
    picture = draw_picture()
    grey = picture[..., 1]
    if shows == "grey":
        return np.dstack([grey] * 3)
    if shows == "two_tone":
        return np.dstack([np.where(grey > 110, 255, 0)] * 3).astype(np.uint8)
    if shows == "cut_out":
        return np.where(alpha()[..., None] > 0, picture, 255).astype(np.uint8)
    if shows == "inks":
        return np.full((32, 48, 3), (0, 151, 218), np.uint8)
    return picture


def alpha() -> Pixels:
    """Return the transparency, 0 or 255, of the files that show `cut_out`."""
    return np.where(np.mgrid[:32, :48][1] < 10, 0, 255).astype(np.uint8)


def deep(bits: int, *, colour: bool = False) -> NDArray[np.uint16]:
    """Return the picture's green channel, or the picture, in samples of `bits` bits."""
    image = draw_picture() if colour else draw_picture()[..., 1]
    return np.round(image / 255.0 * (2**bits - 1)).astype(np.uint16)


def oriented(orientation: int) -> tuple[Image.Image, Image.Exif]:
    """Return the picture as it is stored with an EXIF `orientation`, and the EXIF data that say so."""
    undo = {
        1: lambda a: a,
        2: np.fliplr,
        3: lambda a: np.rot90(a, 2),
        4: np.flipud,
        5: lambda a: a.transpose(1, 0, 2),
        6: np.rot90,
        7: lambda a: np.rot90(a, 2).transpose(1, 0, 2),
        8: lambda a: np.rot90(a, -1),
    }
    exif = Image.Exif()
    exif[0x0112] = orientation
    return Image.fromarray(np.ascontiguousarray(undo[orientation](draw_picture()))), exif
