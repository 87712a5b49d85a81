"""Walk through a large image in groups of rows, so that no operation copies all of it."""

from collections.abc import Iterator

from PIL import Image

_PIXELS = 2**20
"""Pixels of a group: 4 MB in Pillow, which a processor's cache holds."""


def iterate_rows(image: Image.Image) -> Iterator[tuple[int, Image.Image]]:
    """Yield (top, rows) for groups of rows of the decoded `image`, from its top to its bottom."""
    step = max(1, _PIXELS // image.width)
    for top in range(0, image.height, step):
        yield top, image.crop((0, top, image.width, min(top + step, image.height)))
