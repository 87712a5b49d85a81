"""Read the resolution that a scanner wrote into a file's header."""

import math
from pathlib import Path

from PIL import ExifTags, Image

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import open_header

_DEFAULTS = (72, 96)
"""Dots per inch that programs write without having measured anything."""
_TOLERANCE = 0.005
"""Resolutions across and down that differ by at most this share are the same."""
_ROUNDING = 1e-4
_CAMERA_TAGS = (ExifTags.Base.ExposureTime, ExifTags.Base.FNumber, ExifTags.Base.FocalLength)


def read_dpi(path: Path, *, page: int | None = None) -> float:
    """Return the dots per inch in the header of the photo at `path`, of a TIFF those of `page`.

    Raises InputError if there are none, if they are 72 or 96, which programs write by default, if they differ
    across and down, and if the photo is a camera's, whose resolution is a convention.
    """
    with open_header(path, page=page) as image:
        dpi = _find_dpi(image)
        is_camera = _has_camera_tags(image)
    if dpi is None:
        raise InputError(f"{path} states no resolution; give the scanner's with --dpi N")
    across, down = dpi
    if is_camera:
        raise InputError(
            f"{path} is a camera's photo: its {across:g} dpi say nothing of its scale; leave out --dpi file, "
            "or give the scale with --px-per-mm N"
        )
    if abs(across - down) > _TOLERANCE * max(across, down):
        raise InputError(
            f"{path} states {across:g} dpi across and {down:g} dpi down; scan with the same resolution in "
            "both directions"
        )
    if any(abs(across - default) < 0.5 for default in _DEFAULTS):
        raise InputError(
            f"{path} states {across:g} dpi, which programs write by default; give the scanner's with --dpi N"
        )
    mean = math.sqrt(across * down)
    # PNG and BMP store whole pixels per metre: 300 dpi become 299.9994.
    return float(round(mean)) if abs(mean - round(mean)) < _ROUNDING * mean else mean


def _find_dpi(image: Image.Image) -> tuple[float, float] | None:
    try:
        across, down = map(float, image.info["dpi"])
    # Hostile headers hold anything.
    except (KeyError, TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    is_stated = math.isfinite(across) and math.isfinite(down) and across > 1 and down > 1
    return (across, down) if is_stated else None


def _has_camera_tags(image: Image.Image) -> bool:
    try:
        tags = image.getexif()
        details = tags.get_ifd(ExifTags.IFD.Exif)
    except Exception:  # Damaged metadata.
        return False
    return any(tag in tags or tag in details for tag in _CAMERA_TAGS)
