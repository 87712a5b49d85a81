"""TIFF as scanners and cameras write it: 16-bit samples of 10 to 16 bits, inverted grey, several pages.

Pillow takes 16-bit colour for 8-bit colour by dropping the low bytes, which leaves 16 levels of 12-bit data;
it does not invert 16-bit grey where 0 means white, and it misreads 16-bit colour stored plane by plane.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image, TiffImagePlugin

from laesi_tf.data.image_rows import iterate_rows

_BITS, _PHOTOMETRIC, _PLANES = 258, 262, 284
_NEW_SUBFILE_TYPE, _SUBFILE_TYPE, _SUB_IFDS, _DNG_VERSION = 254, 255, 330, 50706
_SWAPPED_ENDS = {"L": "B", "B": "L", "N": "B" if sys.byteorder == "little" else "L"}

MAX_IMAGES = 2000
"""Images of a TIFF that are looked at, pages and thumbnails: a small hostile file can list millions."""


class TiffPhoto(TiffImagePlugin.TiffImageFile):
    """A TIFF whose pages decode to what they show; the white of 16-bit grey is left to the caller."""

    is_inverted = False
    """Whether 0 is white in the grey that was decoded: Pillow inverts 8 bits, and nothing deeper."""
    _takes_low_bytes = False

    def _setup(self) -> None:
        bits = self.tag_v2.get(_BITS, (1,))
        is_deep = max(bits) > 8
        self.is_inverted = is_deep and self.tag_v2.get(_PHOTOMETRIC) == 0
        if self.is_inverted:
            self.tag_v2[_PHOTOMETRIC] = 1  # Pillow knows both only for little-endian files.
        super()._setup()
        if is_deep and not self.use_load_libtiff and self.tag_v2.get(_PLANES) == 2 and len(bits) > 1:
            end = ";16B" if self.tag_v2.prefix == b"MM" else ";16L"
            self._change_kind(lambda plane: plane + end)
        if self._takes_low_bytes:
            self._change_kind(lambda kind: kind[:-1] + _SWAPPED_ENDS[kind[-1]])

    def _change_kind(self, change: Callable[[str], str]) -> None:
        """Change what the samples of each tile are decoded as, such as RGB;16B."""
        for number, tile in enumerate(self.tile):
            assert isinstance(tile.args, tuple)
            self.tile[number] = tile._replace(args=(change(tile.args[0]), *tile.args[1:]))

    @property
    def is_raw(self) -> bool:
        """Whether this is a camera's raw file, whose first image is only a preview."""
        return _DNG_VERSION in self.tag_v2 or (_SUB_IFDS in self.tag_v2 and self.is_reduced)

    @property
    def is_reduced(self) -> bool:
        """Whether the page is a smaller copy of another, or a transparency mask."""
        kind = self.tag_v2.get(_NEW_SUBFILE_TYPE, 0)
        return bool(isinstance(kind, int) and kind & 0b101) or self.tag_v2.get(_SUBFILE_TYPE) == 2

    @property
    def has_dropped_bytes(self) -> bool:
        """Whether Pillow drops the low bytes of the page's samples while it decodes."""
        return self.mode == "RGB" and set(self.tag_v2.get(_BITS, (8,))) == {16}


class _LowBytes(TiffPhoto):
    """The low bytes of a TIFF's 16-bit colour: the high ones if it is read in the other byte order."""

    _takes_low_bytes = True


def restore_dropped_bits(image: TiffPhoto, path: Path) -> None:
    """Scale decoded 16-bit colour whose samples use fewer bits, in place, so that its white becomes 255."""
    # Of three channels, getextrema returns a pair each.
    brightest = int(np.max(image.getextrema()))
    white = choose_white(256 * brightest + 255)
    if white == 65535:
        return
    with _LowBytes(path) as low:
        low.seek(image.tell())
        low.load()
        for top, low_rows in iterate_rows(low):
            box = (0, top, image.width, top + low_rows.height)
            values = np.asarray(image.crop(box)).astype(np.uint32) * 256 + np.asarray(low_rows)
            scaled = np.minimum((values * 255 + white // 2) // white, 255).astype(np.uint8)
            image.paste(Image.fromarray(scaled), box)


def choose_white(brightest: int) -> int:
    """Return the value that becomes 255, of samples of 16 bits with the `brightest` value 0..65535.

    Cameras and scanners of 10, 12 and 14 bits store their numbers unchanged in 16-bit samples, and no tag
    says so. The data do: white is the largest number of the fewest of 8, 10, 12, 14 and 16 bits that hold
    the brightest pixel. An underexposed photo, with paper darker than a quarter of white, becomes brighter.
    """
    return next(2**bits - 1 for bits in (8, 10, 12, 14, 16) if brightest < 2**bits)


def find_pages(path: Path) -> list[int]:
    """Return the index of each page of the TIFF at `path`, without thumbnails, masks and smaller copies.

    The last index may be MAX_IMAGES, which stands for all further ones, or that of a damaged page, behind
    which none can be found. Raises what Pillow raises if not even the first image can be opened.
    """
    pages = []
    with TiffPhoto(path) as image:
        for index in range(MAX_IMAGES + 1):
            try:
                image.seek(index)
            except EOFError:  # There are no more.
                break
            # Pillow raises almost anything for a damaged one.
            except Exception:
                pages.append(index)
                break
            if not image.is_reduced:
                pages.append(index)
    return pages or [0]
