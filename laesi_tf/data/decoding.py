"""Photographs as phones, scanners and browsers make them, decoded safely.

Every picture comes out the same way: uint8 [H, W, 3] RGB, upright (EXIF orientation applied), at the file's
full resolution, since a millimetre on the paper is what is measured. A file that cannot be used raises
InputError with one line that says what, where and what to do; nothing else is raised, whatever the bytes.
"""

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from laesi_tf.common.errors import InputError

# Phone sensors go to 108 megapixels (12000 x 9000) in ordinary use; 120 leaves room for them and keeps the
# worst file at 360 MB of pixels. It is compared with the header, so a 0.75 MB PNG that claims 16000 x 16000
# costs nothing. It lies under the 179 megapixels at which Pillow itself gives up.
MAX_PIXELS = 120_000_000

# What is tried. Left out on purpose are Pillow's readers that start other programs (EPS) and those for
# files that neither a camera nor a scanner writes. MPO, a phone's JPEG with a second picture, comes as JPEG.
FORMATS = ("JPEG", "PNG", "TIFF", "GIF", "WEBP", "BMP")

# Names by which a file in a folder is taken for a photo. HEIC, AVIF and raw files are here so that they are
# named as unreadable instead of being passed over in silence.
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

# Pillow warns of damaged metadata and of sizes that are under our own limit; neither stops a measurement,
# and a command's lines are no place for it.
warnings.filterwarnings("ignore", module=r"PIL\..*")


def decode_photo(path: Path | str) -> np.ndarray:
    """Return the photo at `path` as uint8 [H, W, 3] RGB, upright, at full resolution, not writable.

    Transparency is laid over white: what is transparent was cut away by someone, the paper is white, and the
    colour stored under a transparent pixel means nothing. Deeper pixels are scaled to 8 bits, not clipped.
    Raises InputError.
    """
    with _open_image(path) as picture:
        return np.asarray(
            _convert_mode(_flatten_transparency(_to_eight_bit(_rotate_upright(picture)), "white"), "RGB")
        )


def decode_mask(path: Path | str) -> np.ndarray:
    """Return the mask at `path` as bool [H, W], True where there is leaf.

    Leaf is what is brighter than half the brightest pixel, not brighter than 127: masks of 0 and 1 are as
    common as masks of 0 and 255. Transparent pixels are not leaf. Raises InputError, also for a mask
    without any leaf.
    """
    with _open_image(path) as picture:
        grey = np.asarray(
            _convert_mode(_flatten_transparency(_to_eight_bit(_rotate_upright(picture)), "black"), "L")
        )
    if not grey.any():
        raise InputError(f"mask {path} has no leaf in it; paint the leaf white on black")
    return grey > grey.max() / 2


def read_upright_size(path: Path | str) -> tuple[int, int]:
    """(height, width) in pixels as `decode` would give them, from the header alone. Raises InputError."""
    with _open_image(path) as picture:
        width, height = picture.size
        # Pillow turns the size of a TIFF itself.
        turned = picture.format != "TIFF" and _exif_orientation(picture) in (5, 6, 7, 8)
        return (width, height) if turned else (height, width)


@contextlib.contextmanager
def _open_image(path: Path | str) -> Iterator[Image.Image]:
    """Open `path`, check its header and yield the undecoded picture; whatever goes wrong is an InputError."""
    path = Path(path)
    try:
        _require_file(path)
        with Image.open(path, formats=FORMATS) as picture:
            if picture.width * picture.height > MAX_PIXELS:
                raise InputError(_too_large_message(path, f"{picture.width} x {picture.height} pixels"))
            yield picture
    except InputError:
        raise
    except UnidentifiedImageError:
        raise InputError(_unknown_format_message(path)) from None
    except Image.DecompressionBombError:
        raise InputError(_too_large_message(path, "over 178 megapixels")) from None
    # Hostile bytes make Pillow raise almost anything: SyntaxError, struct.error, KeyError, OverflowError.
    except Exception as error:
        system = error.strerror if isinstance(error, OSError) else None
        what = f"cannot read {path}: {system}" if system else f"{path} cannot be decoded ({error})"
        raise InputError(f"{what}; copy it again or save it anew as JPEG or PNG") from None


def _require_file(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a picture; name a file in it")
    if not path.is_file():
        raise InputError(f"there is no picture at {path}; check the name")
    if path.stat().st_size == 0:
        raise InputError(f"{path} is empty (0 bytes); copy it again from the camera")


def _unknown_format_message(path: Path) -> str:
    with path.open("rb") as file:
        if file.read(8)[4:] == b"ftyp":
            return (
                f"{path} is a HEIC, AVIF or video file, which is not read; convert it to JPEG "
                "(iPhone: Settings, Camera, Formats, Most Compatible)"
            )
    return f"{path} is not a picture in a known format; save it as JPEG, PNG, TIFF, WebP, GIF or BMP"


def _too_large_message(path: Path, claim: str) -> str:
    limit = MAX_PIXELS // 1_000_000
    return f"{path} claims {claim}, more than the {limit} megapixels that are read; make it smaller"


def _exif_orientation(picture: Image.Image) -> int:
    """The EXIF orientation 1..8; 1 too where metadata is damaged, which says nothing about the pixels."""
    try:
        return int(picture.getexif().get(_ORIENTATION_TAG, 1))
    except Exception:
        return 1


def _rotate_upright(picture: Image.Image) -> Image.Image:
    """Decode and turn `picture` as its EXIF orientation says."""
    # TIFF turns itself on loading and then drops the tag, so the tag is looked at afterwards.
    picture.load()
    turn = _TRANSPOSITIONS.get(_exif_orientation(picture))
    return picture if turn is None else picture.transpose(turn)


def _to_eight_bit(picture: Image.Image) -> Image.Image:
    """Scale 16-bit grey to 8 bits; Pillow's own conversion would clip everything above 255 to white.

    16-bit colour needs nothing: Pillow keeps the high byte of each channel while it decodes.
    """
    if picture.mode == "F":
        raise ValueError("its pixels are floating-point numbers, of which none is known to be white")
    if not picture.mode.startswith("I"):
        return picture
    values = np.asarray(picture).astype(np.int64)
    if values.min() < 0 or values.max() > 65535:
        raise ValueError("its pixels have more than 16 bits, so that none is known to be white")
    return Image.fromarray(((values * 255 + 32767) // 65535).astype(np.uint8))


def _flatten_transparency(picture: Image.Image, background: str) -> Image.Image:
    """Lay a picture with transparency of any kind (channel, palette entry, key colour) over `background`."""
    if not picture.has_transparency_data:
        return picture
    layer = _convert_mode(picture, "RGBA")
    return Image.alpha_composite(Image.new("RGBA", layer.size, background), layer)


def _convert_mode(picture: Image.Image, mode: str) -> Image.Image:
    """`picture` in `mode`; Pillow would copy one that is in it already."""
    return picture if picture.mode == mode else picture.convert(mode)
