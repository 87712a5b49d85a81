"""Decode photos from phones, scanners and browsers safely.

Every photo becomes uint8 [H, W, 3] RGB, upright (EXIF orientation applied), at the file's full resolution,
since the ruling needs it. A file that cannot be used raises InputError with one line that says what, where
and what to do; no bytes raise anything else.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from laesi_tf.common.errors import InputError

# Phone sensors go to 108 megapixels (12000 x 9000) in ordinary use; 120 leaves room for them and limits the
# worst file to 360 MB of pixels. It is compared with the header, so a 0.75 MB PNG that claims 16000 x 16000
# costs nothing. Pillow itself refuses 179 megapixels.
MAX_PIXELS = 120_000_000

# Not here: Pillow's readers that start other programs (EPS), and those of formats that neither a camera nor a
# scanner writes. Pillow opens MPO, a phone's JPEG with a second image, as JPEG.
FORMATS = ("JPEG", "PNG", "TIFF", "GIF", "WEBP", "BMP")

# A file in a folder is a photo if it has one of these suffixes. HEIC, AVIF and raw files are here so that
# they are reported as unreadable instead of being ignored.
PHOTO_SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".jpe", ".mpo", ".png", ".tif", ".tiff", ".gif", ".webp", ".bmp"}
    | {".heic", ".heif", ".avif", ".dng", ".cr2", ".nef", ".arw"}
)

_ORIENTATION_TAG = 0x0112
_TRANSPOSITIONS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}


def decode_photo(path: Path | str) -> NDArray[np.uint8]:
    """Decode the photo at `path` to uint8 [H, W, 3] RGB, upright, at full resolution, not writable.

    Transparent pixels become white: somebody cut them away, the paper is white, and the colour stored under a
    transparent pixel means nothing. Deeper pixels are scaled to 8 bits, not clipped. Raises InputError.
    """
    with _open_image(path) as image:
        return np.asarray(_convert_mode(_decode_upright(image, background="white"), "RGB"))


def decode_mask(path: Path | str) -> NDArray[np.bool_]:
    """Decode the mask at `path` to bool [H, W], True on the leaf.

    The leaf is what is brighter than half the brightest pixel, not brighter than 127: masks of 0 and 1 are as
    common as masks of 0 and 255. Transparent pixels are not leaf. Raises InputError, also for a mask
    without any leaf.
    """
    with _open_image(path) as image:
        grey = np.asarray(_convert_mode(_decode_upright(image, background="black"), "L"))
    if not grey.any():
        raise InputError(f"mask {path} has no leaf in it; paint the leaf white on black")
    return grey > grey.max() / 2


def read_upright_size(path: Path | str) -> tuple[int, int]:
    """Read the (height, width) that `decode_photo` would give, from the header alone. Raises InputError."""
    with _open_image(path) as image:
        width, height = image.size
        # Pillow itself rotates the size of a TIFF.
        is_transposed = image.format != "TIFF" and _exif_orientation(image) in (5, 6, 7, 8)
        return (width, height) if is_transposed else (height, width)


@contextlib.contextmanager
def _open_image(path: Path | str) -> Iterator[Image.Image]:
    """Open `path`, check its header and yield the image, not decoded; turn every error into InputError."""
    path = Path(path)
    try:
        _require_file(path)
        with Image.open(path, formats=FORMATS) as image:
            if image.width * image.height > MAX_PIXELS:
                raise InputError(_too_large_message(path, f"{image.width} x {image.height} pixels"))
            yield image
    except InputError:
        raise
    except UnidentifiedImageError:
        raise InputError(_unknown_format_message(path)) from None
    except Image.DecompressionBombError:
        raise InputError(_too_large_message(path, "over 178 megapixels")) from None
    # Hostile bytes make Pillow raise almost anything: SyntaxError, struct.error, KeyError, OverflowError.
    except Exception as error:
        reason = error.strerror if isinstance(error, OSError) else None
        what = f"cannot read {path}: {reason}" if reason else f"{path} cannot be decoded ({error})"
        raise InputError(f"{what}; copy it again or save it as JPEG or PNG") from None


def _require_file(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a photo; name a file in it")
    if not path.is_file():
        raise InputError(f"file not found: {path}")
    if path.stat().st_size == 0:
        raise InputError(f"{path} is empty (0 bytes); copy it again from the camera")


def _unknown_format_message(path: Path) -> str:
    with path.open("rb") as file:
        if file.read(8)[4:] == b"ftyp":
            return (
                f"{path} is a HEIC, AVIF or video file, which is not supported; convert it to JPEG "
                "(iPhone: Settings, Camera, Formats, Most Compatible)"
            )
    return f"{path} is not an image in a known format; save it as JPEG, PNG, TIFF, WebP, GIF or BMP"


def _too_large_message(path: Path, claim: str) -> str:
    limit = MAX_PIXELS // 1_000_000
    return f"{path} claims {claim}, more than the limit of {limit} megapixels; make it smaller"


def _exif_orientation(image: Image.Image) -> int:
    """Return the EXIF orientation 1..8; 1 if the metadata is damaged, which says nothing about the pixels."""
    try:
        return int(image.getexif().get(_ORIENTATION_TAG, 1))
    except Exception:
        return 1


def _decode_upright(image: Image.Image, *, background: str) -> Image.Image:
    """Decode `image`, rotate it as its EXIF orientation says, reduce it to 8 bits, without transparency."""
    # Pillow rotates a TIFF on loading and then drops the tag, so read the tag afterwards.
    image.load()
    transposition = _TRANSPOSITIONS.get(_exif_orientation(image))
    upright = image if transposition is None else image.transpose(transposition)
    return _flatten_transparency(_to_eight_bit(upright), background)


def _to_eight_bit(image: Image.Image) -> Image.Image:
    """Scale 16-bit grey to 8 bits; Pillow's own conversion would clip everything above 255 to white.

    16-bit colour needs nothing: Pillow keeps the high byte of each channel while it decodes.
    """
    if image.mode == "F":
        raise ValueError("its pixels are floating-point numbers, which have no defined white")
    if not image.mode.startswith("I"):
        return image
    values = np.asarray(image).astype(np.int64)
    if values.min() < 0 or values.max() > 65535:
        raise ValueError("its pixels have more than 16 bits, which have no defined white")
    return Image.fromarray(((values * 255 + 32767) // 65535).astype(np.uint8))


def _flatten_transparency(image: Image.Image, background: str) -> Image.Image:
    """Composite transparency of any kind (channel, palette entry, key colour) over `background`."""
    if not image.has_transparency_data:
        return image
    layer = _convert_mode(image, "RGBA")
    return Image.alpha_composite(Image.new("RGBA", layer.size, background), layer)


def _convert_mode(image: Image.Image, mode: str) -> Image.Image:
    """Convert `image` to `mode`; Pillow would copy one that has it already."""
    return image if image.mode == mode else image.convert(mode)
