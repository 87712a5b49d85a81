"""The photos in a file: one, or one on each page of a TIFF."""

from dataclasses import dataclass
from pathlib import Path

from laesi_tf.data import file_formats
from laesi_tf.data.tiff_photo import find_pages


@dataclass(frozen=True)
class PhotoPage:
    """One photo: a file, or a page of a TIFF of several."""

    path: Path
    index: int = 0
    """What `decode_photo` takes as its `page`."""
    number: int | None = None
    """The page's number from 1, as people count; None if the file has only one."""

    def __str__(self) -> str:
        """Return its path, followed by its number where the file has several: scans/leaf.tif#2."""
        return f"{self.path}{self.ending}"

    @property
    def name(self) -> str:
        """Its file name, followed by its number where the file has several."""
        return f"{self.path.name}{self.ending}"

    @property
    def ending(self) -> str:
        """Its number as it is written behind the file's name: #2; empty where the file has only one."""
        return "" if self.number is None else f"#{self.number}"


def list_pages(path: Path) -> list[PhotoPage]:
    """Return the photos in the file at `path`: at least one, which fails to decode if the file is damaged."""
    try:
        # A named pipe would be waited for.
        is_tiff = path.is_file() and file_formats.is_tiff(file_formats.read_header(path))
        indices = find_pages(path) if is_tiff else [0]
    # The same error is reported when the photo is decoded.
    except Exception:
        indices = [0]
    if len(indices) == 1:
        return [PhotoPage(path, indices[0])]
    return [PhotoPage(path, index, number) for number, index in enumerate(indices, 1)]
