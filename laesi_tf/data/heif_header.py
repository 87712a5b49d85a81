"""Read from a HEIC file's header how large its images are before they are cropped.

A HEIC image is coded at one size and may be cropped to another; its reader states only the second.
"""

import re
import struct
from pathlib import Path

_MAX_META_BYTES = 16_000_000
"""Properties of a photo take a few kilobytes, of a grid of a thousand tiles 100."""


def read_coded_sizes(path: Path) -> list[tuple[int, int]]:
    """Return the (width, height) of every image, tile and thumbnail that the file at `path` describes."""
    meta = _read_meta_box(path)
    # A size is a box of 20 bytes: length, "ispe", version and flags, width, height.
    sizes = re.finditer(rb"\0\0\0\x14ispe....(....)(....)", meta, re.DOTALL)
    return [(int.from_bytes(size[1], "big"), int.from_bytes(size[2], "big")) for size in sizes]


def _read_meta_box(path: Path) -> bytes:
    """Return the content of the box that describes the images; it is empty if there is none."""
    with path.open("rb") as file:
        while len(head := file.read(8)) == 8:
            length, kind = struct.unpack(">I4s", head)
            size = length - 8
            if length == 1:  # A length of 64 bits follows.
                size = int.from_bytes(file.read(8), "big") - 16
            if kind == b"meta":
                return file.read(min(size, _MAX_META_BYTES) if size >= 0 else _MAX_META_BYTES)
            if size < 0:  # The box ends with the file.
                break
            file.seek(size, 1)
    return b""
