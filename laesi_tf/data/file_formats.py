"""Recognise a photo's format by its first bytes, and refuse by name the formats that are not read.

Suffixes decide only which files of a folder are photos: phones and messengers write JPEG with any suffix.
"""

from collections.abc import Mapping
from pathlib import Path

from laesi_tf.common.errors import InputError

RAW_FORMATS: Mapping[str, str] = {
    ".dng": "DNG",
    ".gpr": "GoPro GPR",
    ".cr2": "Canon CR2",
    ".cr3": "Canon CR3",
    ".crw": "Canon CRW",
    ".nef": "Nikon NEF",
    ".nrw": "Nikon NRW",
    ".arw": "Sony ARW",
    ".sr2": "Sony SR2",
    ".srf": "Sony SRF",
    ".orf": "Olympus ORF",
    ".rw2": "Panasonic RW2",
    ".rwl": "Leica RWL",
    ".raf": "Fujifilm RAF",
    ".pef": "Pentax PEF",
    ".srw": "Samsung SRW",
    ".3fr": "Hasselblad 3FR",
    ".fff": "Hasselblad FFF",
    ".iiq": "Phase One IIQ",
    ".mrw": "Minolta MRW",
    ".mef": "Mamiya MEF",
    ".mos": "Leaf MOS",
    ".erf": "Epson ERF",
    ".kdc": "Kodak KDC",
    ".dcr": "Kodak DCR",
    ".x3f": "Sigma X3F",
}
"""Name of the raw format that each suffix stands for."""

PHOTO_SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".jpe", ".jfif", ".mpo", ".png", ".tif", ".tiff", ".gif", ".webp", ".bmp", ".dib"}
    | {".heic", ".heif", ".heics", ".heifs", ".hif", ".avif", ".avifs"}
    # Not read, but listed, so that they are reported instead of being passed over.
    | {".jxl", ".jp2", ".psd", ".pdf", *RAW_FORMATS}
)
"""A file in a folder is a photo if it has one of these suffixes, case ignored."""

_HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"hevm", b"hevs", b"mif1", b"msf1")
_AVIF_BRANDS = (b"avif", b"avis")
_TIFF_SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # The last two are BigTIFF.

_RAW_SIGNATURES = (
    (0, b"IIRO", ".orf"),
    (0, b"IIRS", ".orf"),
    (0, b"MMOR", ".orf"),
    (0, b"IIU\0", ".rw2"),
    (0, b"FUJIFILMCCD-RAW", ".raf"),
    (0, b"FOVb", ".x3f"),
    (0, b"\0MRM", ".mrw"),
    (4, b"ftypcrx ", ".cr3"),
    (6, b"HEAPCCDR", ".crw"),
    (8, b"CR\x02", ".cr2"),
)
_OTHER_SIGNATURES = (
    (b"\xff\x0a", "a JPEG XL file"),
    (b"\0\0\0\x0cJXL \r\n\x87\n", "a JPEG XL file"),
    (b"\xff\x4f\xff\x51", "a JPEG 2000 file"),
    (b"\0\0\0\x0cjP  \r\n\x87\n", "a JPEG 2000 file"),
    (b"8BPS", "a Photoshop file"),
    (b"%PDF", "a PDF"),
)

HEADER_BYTES = 64
"""Number of first bytes that recognising a format takes."""


def read_header(path: Path) -> bytes:
    """Read the first bytes of the file at `path`. Raises OSError."""
    with path.open("rb") as file:
        return file.read(HEADER_BYTES)


def is_tiff(header: bytes) -> bool:
    """Return whether `header` begins a TIFF; many raw files do, too."""
    return header.startswith(_TIFF_SIGNATURES)


def is_heif(header: bytes) -> bool:
    """Return whether `header` begins a HEIC or HEIF file. The brand mif1 alone leaves AVIF possible."""
    brands = _read_brands(header)
    return any(brand in _HEIF_BRANDS for brand in brands) and not any(
        brand in _AVIF_BRANDS for brand in brands
    )


def is_read_whole(header: bytes) -> bool:
    """Return whether the reader of the format takes the whole file into memory: HEIC, AVIF and WebP."""
    return header[4:8] == b"ftyp" or header.startswith(b"RIFF")


def name_format(header: bytes) -> str:
    """Return the name of a format that has a reader of its own; "" for the others."""
    return "HEIC" if is_heif(header) else "TIFF" if is_tiff(header) else ""


def refuse_unsupported(path: Path, header: bytes) -> None:
    """Raise InputError if `header` begins a file of a known format that is not read."""
    for offset, signature, suffix in _RAW_SIGNATURES:
        if header.startswith(signature, offset):
            raise InputError(raw_message(path, suffix))
    if is_tiff(header) and path.suffix.lower() in RAW_FORMATS:
        raise InputError(raw_message(path, path.suffix.lower()))
    for signature, name in _OTHER_SIGNATURES:
        if header.startswith(signature):
            raise InputError(f"{path} is {name}, which is not read; save its image as JPEG, PNG or TIFF")
    brands = _read_brands(header)
    if brands and not any(brand in (*_HEIF_BRANDS, *_AVIF_BRANDS) for brand in brands):
        raise InputError(f"{path} is a video or sound, which is not read; take a photo, or save a frame")


def raw_message(path: Path, suffix: str) -> str:
    """Return the message for a raw file of the format that `suffix` stands for.

    The only image in it that could be decoded simply is a small preview, often of another crop.
    """
    name = f" ({RAW_FORMATS[suffix]})" if suffix in RAW_FORMATS else ""
    return f"{path} is a raw file{name}, which is not read; develop it to JPEG or TIFF and name that file"


def unknown_format_message(path: Path) -> str:
    """Return the message for a file that no reader recognises."""
    suffix = path.suffix.lower()
    if suffix in RAW_FORMATS:
        return raw_message(path, suffix)
    return f"{path} is not an image in a known format; save it as JPEG, PNG, TIFF, HEIC, WebP or AVIF"


def _read_brands(header: bytes) -> tuple[bytes, ...]:
    """Return the brands, the major one first, of a file in ISO's base media format; none of any other."""
    if header[4:8] != b"ftyp":
        return ()
    end = min(int.from_bytes(header[:4], "big"), len(header))
    return header[8:12], *(header[start : start + 4] for start in range(16, end - 3, 4))
