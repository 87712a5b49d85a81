"""Decode photos from phones, scanners and browsers safely.

Every photo becomes uint8 [H, W, 3] sRGB, upright (orientation applied), at the file's full resolution, since
the ruling needs it. A file that cannot be used raises InputError with one line that says what, where and what
to do; no bytes raise anything else.
"""

import contextlib
import errno
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pillow_heif import HeifImageFile

from laesi_tf.common.errors import InputError
from laesi_tf.data import file_formats
from laesi_tf.data.heif_header import read_coded_sizes
from laesi_tf.data.tiff_photo import MAX_IMAGES, TiffPhoto, find_pages, restore_dropped_bits
from laesi_tf.data.upright_pixels import orient_size, read_orientation, to_upright_grey, to_upright_rgb

# Phone sensors go to 200 megapixels (16320 x 12240), an A4 page at 1200 dpi has 139. It is compared with the
# header, so a 0.75 MB PNG that claims 16000 x 16000 costs nothing.
#
# JPEG's draft mode, which decodes a photo at half its size or less, is not used, although the overview of a
# photo has 1536 pixels at most. Leaves and ruling are measured in crops at full resolution, a scale or a mask
# that the user gives refers to the file's pixels, and memory is bounded without it.
MAX_PIXELS = 200_000_000

# Decoding takes 7 to 11 bytes a pixel. Two photos of more pixels than this are not decoded at the same time.
_LARGE_PIXELS = 50_000_000
_large_photo = threading.Lock()

# Of the formats that are read as a whole; none of them makes a photo of MAX_PIXELS larger than its pixels.
_MAX_BYTES = 3 * MAX_PIXELS

# Not here: Pillow's readers that start other programs (EPS), and those of formats that neither a camera nor a
# scanner writes. Pillow opens MPO and Ultra HDR, a JPEG with further images behind it, as JPEG. TIFF and HEIC
# have readers of their own below.
FORMATS = ("JPEG", "PNG", "GIF", "WEBP", "BMP", "AVIF")

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/")
"""How a URL begins, also one whose double slash a Path has made a single one; not a drive's letter."""


def decode_photo(path: Path | str, *, page: int | None = None) -> NDArray[np.uint8]:
    """Decode the photo at `path` to uint8 [H, W, 3] sRGB, upright, at full resolution, not writable.

    `page` is the index of an image in a TIFF (see `list_pages`), by default that of its first page.
    Transparent pixels become white: somebody cut them away, the paper is white, and the colour stored under a
    transparent pixel means nothing. Deeper pixels are scaled to 8 bits, not clipped. Raises InputError.
    """
    with _open_image(path, page) as image, _decode_pixels(image, Path(path)):
        return to_upright_rgb(image)


def decode_mask(path: Path | str) -> NDArray[np.bool_]:
    """Decode the mask at `path` to bool [H, W], True on the leaf.

    The leaf is what is brighter than half the brightest pixel, not brighter than 127: masks of 0 and 1 are as
    common as masks of 0 and 255. Transparent pixels are not leaf. Raises InputError, also for a mask
    without any leaf.
    """
    with _open_image(path) as image, _decode_pixels(image, Path(path)):
        grey = to_upright_grey(image)
    if not grey.any():
        raise InputError(f"mask {path} has no leaf in it; paint the leaf white on black")
    return grey > grey.max() / 2


def read_upright_size(path: Path | str) -> tuple[int, int]:
    """Read the (height, width) that `decode_photo` would give, from the header alone. Raises InputError."""
    with _open_image(path) as image:
        # Pillow itself rotates the size of a TIFF.
        return orient_size(image.size, 1 if image.format == "TIFF" else read_orientation(image))


@contextlib.contextmanager
def open_header(path: Path | str, *, page: int | None = None) -> Iterator[Image.Image]:
    """Yield the photo at `path`, not decoded, for what its header says; `page` as in `decode_photo`.

    Raises InputError.
    """
    with _open_image(path, page) as image:
        yield image


def require_path(text: str) -> Path:
    """Return `text` as a path. Raises InputError if it is empty, or a URL, of which Path drops a slash."""
    if not text:
        raise InputError("'' names nothing; name a photo or a folder")
    if _URL.match(text) and not Path(text).exists():
        raise InputError(f"{text} is a URL, and URLs are not opened; save the photo and name its file")
    return Path(text)


@contextlib.contextmanager
def _open_image(path: Path | str, page: int | None = None) -> Iterator[Image.Image]:
    """Open `path`, check its header and yield the image, not decoded; turn every error into InputError."""
    kind = ""
    try:
        path = require_path(str(path))
        _require_file(path)
        header = file_formats.read_header(path)
        file_formats.refuse_unsupported(path, header)
        if name := file_formats.name_format(header):
            kind = f" as {name}"
        with _PILLOW_LIMIT, _open_format(path, header) as image:
            if isinstance(image, TiffPhoto):
                _select_page(image, path, page)
            _require_size(path, image.width, image.height)
            yield image
    except InputError:
        raise
    except UnidentifiedImageError:
        raise InputError(file_formats.unknown_format_message(Path(path))) from None
    except Image.DecompressionBombError:
        claim = f"over {2 * MAX_PIXELS // 1_000_000} megapixels"
        raise InputError(_too_large_message(Path(path), claim)) from None
    # Hostile bytes make Pillow raise almost anything: SyntaxError, struct.error, KeyError, OverflowError.
    except Exception as error:
        raise InputError(_error_message(Path(path), error, kind)) from None


@contextlib.contextmanager
def _decode_pixels(image: Image.Image, path: Path) -> Iterator[None]:
    """Decode `image`, and let no other large photo be decoded inside this context."""
    is_large = image.width * image.height > _LARGE_PIXELS
    with _large_photo if is_large else contextlib.nullcontext():
        image.load()
        if isinstance(image, TiffPhoto) and image.has_dropped_bytes:
            restore_dropped_bits(image, path)
        yield


def _open_format(path: Path, header: bytes) -> Image.Image:
    """Open the image of any format that is read. Raises whatever Pillow raises."""
    size = path.stat().st_size
    if file_formats.is_read_whole(header) and size > _MAX_BYTES:
        raise InputError(_too_large_message(path, f"{size / 1e6:.0f} MB"))
    if file_formats.is_heif(header):
        for width, height in read_coded_sizes(path):
            _require_size(path, width, height)
        return HeifImageFile(path)  # type: ignore[no-untyped-call]
    if file_formats.is_tiff(header):
        return TiffPhoto(path)
    return Image.open(path, formats=FORMATS)


def _select_page(image: TiffPhoto, path: Path, page: int | None) -> None:
    if image.is_raw:
        raise InputError(file_formats.raw_message(path, path.suffix.lower()))
    if page is None:
        page = find_pages(path)[0] if image.is_reduced else 0
    if page >= MAX_IMAGES:
        raise InputError(f"{path} has more than {MAX_IMAGES} images; split it into several files")
    image.seek(page)


class _PillowLimit:
    """Let Pillow open MAX_PIXELS inside this context, in any number of threads.

    Its own limit, 179 megapixels, is a setting of the process: it is put back for the program's other uses.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._before: int | None = None

    def __enter__(self) -> None:
        with self._lock:
            if not self._users:
                self._before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, MAX_PIXELS
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if not self._users:
                Image.MAX_IMAGE_PIXELS = self._before


_PILLOW_LIMIT = _PillowLimit()


def _require_file(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a photo; name a file in it")
    if not path.is_file():
        raise InputError(f"file not found: {path}")
    if path.stat().st_size == 0:
        raise InputError(f"{path} is empty (0 bytes); copy it again from the camera")


def _require_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise InputError(_too_large_message(path, f"{width} x {height} pixels"))


def _too_large_message(path: Path, claim: str) -> str:
    limit = MAX_PIXELS // 1_000_000
    return f"{path} claims {claim}, more than the limit of {limit} megapixels; make it smaller"


def _error_message(path: Path, error: Exception, kind: str) -> str:
    if isinstance(error, OSError) and error.errno in (errno.EACCES, errno.EPERM):
        return f"cannot read {path}: {error.strerror}; allow its reading, for example with chmod u+r"
    if isinstance(error, OSError) and error.strerror:
        return f"cannot read {path}: {error.strerror}; check the path and the disk"
    reason = " ".join(str(error).split()) or type(error).__name__
    return f"{path} cannot be decoded{kind} ({reason}); copy it again or save it as JPEG or PNG"
