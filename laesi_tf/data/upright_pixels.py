"""Turn a decoded image of any mode and depth into upright 8-bit pixels: sRGB, or grey for masks.

The conversion goes through the image in groups of rows. Beside the decoded image, 4 bytes a pixel in Pillow,
only the result needs memory, 3 bytes a pixel: 1.4 GB for 200 megapixels.
"""

import io
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps

from laesi_tf.data.image_rows import iterate_rows
from laesi_tf.data.tiff_photo import TiffPhoto, choose_white

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
_ROWS_BECOME_COLUMNS = (5, 6, 7, 8)
_LAST_ROWS_COME_FIRST = (3, 4, 6, 7)

_Convert = Callable[[Image.Image], Image.Image]


def read_orientation(image: Image.Image) -> int:
    """Return the EXIF orientation 1..8; 1 if the metadata is damaged, which says nothing about the pixels.

    It is 1 for HEIC, which its reader rotates, and for a TIFF that is loaded, which Pillow rotates.
    """
    try:
        orientation = int(image.getexif().get(_ORIENTATION_TAG, 1))
    except Exception:
        return 1
    return orientation if orientation in _TRANSPOSITIONS else 1


def orient_size(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    """Return the upright (height, width) of an image that is stored with `size` (width, height)."""
    return size if orientation in _ROWS_BECOME_COLUMNS else (size[1], size[0])


def to_upright_rgb(image: Image.Image) -> NDArray[np.uint8]:
    """Return the decoded `image` as upright sRGB, uint8 [H, W, 3], over white where it is transparent."""
    return _convert_upright(image, "RGB", _choose_rgb_conversion(image), background="white")


def to_upright_grey(image: Image.Image) -> NDArray[np.uint8]:
    """Return the decoded `image` as upright grey, uint8 [H, W], over black where it is transparent."""
    return _convert_upright(image, "L", lambda rows: _convert_mode(rows, "L"), background="black")


def _convert_upright(
    image: Image.Image, mode: Literal["RGB", "L"], convert: _Convert, *, background: str
) -> NDArray[np.uint8]:
    orientation = read_orientation(image)
    to_eight_bits = _choose_depth_conversion(image)
    size = orient_size(image.size, orientation)
    pixels = np.empty((*size, 3) if mode == "RGB" else size, np.uint8)
    for top, rows in iterate_rows(image):
        bottom = top + rows.height
        rows = convert(_flatten_transparency(to_eight_bits(rows), background))
        if orientation in _TRANSPOSITIONS:
            rows = rows.transpose(_TRANSPOSITIONS[orientation])
        if orientation in _LAST_ROWS_COME_FIRST:
            top, bottom = image.height - bottom, image.height - top
        if orientation in _ROWS_BECOME_COLUMNS:
            pixels[:, top:bottom] = np.asarray(rows)
        else:
            pixels[top:bottom] = np.asarray(rows)
    pixels.setflags(write=False)
    return pixels


def _choose_depth_conversion(image: Image.Image) -> _Convert:
    """Return what scales 16-bit grey to 8 bits; Pillow's own conversion clips all above 255 to white."""
    if image.mode == "F":
        raise ValueError("its pixels are floating-point numbers, which have no defined white")
    if not image.mode.startswith("I"):
        return lambda rows: rows
    # Pillow has no extrema of big-endian pixels.
    groups = (np.asarray(rows) for _, rows in iterate_rows(image))
    extrema = np.array([(values.min(), values.max()) for values in groups])
    darkest, brightest = extrema[:, 0].min(), extrema[:, 1].max()
    if darkest < 0 or brightest > 65535:
        raise ValueError("its pixels have more than 16 bits, which have no defined white")
    white = choose_white(int(brightest))
    is_inverted = isinstance(image, TiffPhoto) and image.is_inverted

    def scale(rows: Image.Image) -> Image.Image:
        values = np.asarray(rows).astype(np.uint32)
        grey = Image.fromarray(((values * 255 + white // 2) // white).astype(np.uint8))
        return ImageOps.invert(grey) if is_inverted else grey

    return scale


def _choose_rgb_conversion(image: Image.Image) -> _Convert:
    """Return what converts 8-bit rows of `image` to sRGB, by the profile in the file if there is one."""
    try:
        profile, mode = _read_profile(image)
        transform = ImageCms.buildTransform(
            profile,
            ImageCms.createProfile("sRGB"),
            mode,
            "RGB",
            ImageCms.Intent.RELATIVE_COLORIMETRIC,
            ImageCms.Flags.BLACKPOINTCOMPENSATION,
        )
    # LittleCMS and Pillow raise almost anything for hostile bytes. A profile that is damaged or of other
    # channels says nothing about the pixels, and any photo looks nearly right without its profile.
    except Exception:
        return lambda rows: _convert_mode(rows, "RGB")
    return lambda rows: _apply_transform(_convert_mode(rows, mode), transform)


def _read_profile(image: Image.Image) -> tuple[ImageCms.ImageCmsProfile, str]:
    """Return the profile of the image's colours and the mode that it applies to.

    Raises anything where there is none that can be used, also for sRGB, which needs no conversion.
    """
    if image.mode == "LAB":
        return ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")), "LAB"
    opened = ImageCms.ImageCmsProfile(io.BytesIO(image.info["icc_profile"]))
    mode = {"RGB ": "RGB", "GRAY": "L", "CMYK": "CMYK"}[opened.profile.xcolor_space]
    if "sRGB" in (opened.profile.profile_description or "") or not _has_channels_of(image, mode):
        raise ValueError("the profile does not apply")
    return opened, mode


def _apply_transform(rows: Image.Image, transform: ImageCms.ImageCmsTransform) -> Image.Image:
    converted = Image.new("RGB", rows.size)
    transform.apply(rows, converted)
    return converted


def _has_channels_of(image: Image.Image, mode: str) -> bool:
    """Return whether `image` can be converted to the profile's `mode` without loss of colours."""
    if "CMYK" in (mode, image.mode):
        return mode == image.mode
    return mode == "RGB" or image.mode in ("1", "L", "LA", "La") or image.mode.startswith("I")


def _flatten_transparency(rows: Image.Image, background: str) -> Image.Image:
    """Composite transparency of any kind (channel, palette entry, key colour) over `background`."""
    if not rows.has_transparency_data:
        return rows
    # Pillow converts grey with premultiplied alpha to nothing else.
    layer = _convert_mode(_convert_mode(rows, "LA") if rows.mode == "La" else rows, "RGBA")
    return Image.alpha_composite(Image.new("RGBA", layer.size, background), layer)


def _convert_mode(image: Image.Image, mode: str) -> Image.Image:
    """Convert `image` to `mode`; Pillow would copy one that has it already."""
    return image if image.mode == mode else image.convert(mode)
