"""Decoding photos from phones, scanners and browsers, and refusing damaged or hostile files."""

import io
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import MAX_PIXELS, decode_mask, decode_photo, read_upright_size

# Each row and column differs, so that no flip or turn goes unseen.
IMAGE = np.stack(
    [
        np.tile(np.arange(0, 240, 10), (16, 1)),
        np.tile(np.arange(0, 240, 15)[:, None], (1, 24)),
        np.full((16, 24), 90),
    ],
    axis=-1,
).astype(np.uint8)


def encoded(format_: str, image: Image.Image | None = None, **options: object) -> bytes:
    buffer = io.BytesIO()
    (image or Image.fromarray(IMAGE)).save(buffer, format_, **options)
    return buffer.getvalue()


@pytest.fixture
def put(tmp_path: Path) -> Callable[[bytes], Path]:
    def write(content: bytes) -> Path:
        (tmp_path / "image").write_bytes(content)
        return tmp_path / "image"

    return write


@pytest.mark.parametrize(
    ("format_", "tolerance"), [("PNG", 0), ("TIFF", 0), ("BMP", 0), ("GIF", 40), ("WEBP", 12), ("JPEG", 12)]
)
def test_formats(put: Callable[[bytes], Path], format_: str, tolerance: int) -> None:
    image = decode_photo(put(encoded(format_)))
    assert image.dtype == np.uint8 and image.shape == IMAGE.shape and image.flags.c_contiguous
    assert np.abs(image.astype(int) - IMAGE).mean() <= tolerance


UPRIGHT = {
    1: lambda a: a,
    2: np.fliplr,
    3: lambda a: np.rot90(a, 2),
    4: np.flipud,
    5: lambda a: a.transpose(1, 0, 2),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: np.rot90(a, 2).transpose(1, 0, 2),
    8: np.rot90,
    9: lambda a: a,
}


@pytest.mark.parametrize("orientation", UPRIGHT)
@pytest.mark.parametrize(("format_", "tolerance"), [("PNG", 0), ("TIFF", 0), ("JPEG", 12), ("WEBP", 12)])
def test_exif_orientation(
    put: Callable[[bytes], Path], format_: str, tolerance: int, orientation: int
) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = put(encoded(format_, exif=exif))
    expected = UPRIGHT[orientation](IMAGE)
    decoded = decode_photo(path)
    assert decoded.shape == expected.shape and np.abs(decoded.astype(int) - expected).mean() <= tolerance
    assert read_upright_size(path) == expected.shape[:2]


def test_first_image_of_a_phones_mpo_file(put: Callable[[bytes], Path]) -> None:
    double = encoded("MPO", save_all=True, append_images=[Image.new("RGB", (24, 16))])
    assert np.abs(decode_photo(put(double)).astype(int) - IMAGE).mean() <= 12


def test_damaged_exif_is_ignored(put: Callable[[bytes], Path]) -> None:
    assert decode_photo(put(encoded("JPEG", exif=b"Exif\0\0MM\0\x2a\xff\xff\xff\xff"))).shape == IMAGE.shape


def test_transparency_is_white(put: Callable[[bytes], Path]) -> None:
    image = np.dstack([IMAGE, np.full((16, 24), 255, np.uint8)])
    image[:8, :, 3] = 0
    image[8, :, 3] = 128
    decoded = decode_photo(put(encoded("PNG", Image.fromarray(image)))).astype(int)
    assert (decoded[:8] == 255).all() and np.array_equal(decoded[9:], IMAGE[9:])
    assert np.abs(decoded[8] - (IMAGE[8] * 128.0 + 255 * 127) / 255).max() <= 1


def test_transparent_palette_entry_is_white(put: Callable[[bytes], Path]) -> None:
    image = Image.new("P", (4, 2), 1)
    image.putpalette([0, 0, 0, 10, 200, 30])
    image.putpixel((0, 0), 0)
    decoded = decode_photo(put(encoded("PNG", image, transparency=0)))
    assert decoded[0, 0].tolist() == [255, 255, 255] and decoded[1, 1].tolist() == [10, 200, 30]


@pytest.mark.parametrize("format_", ["JPEG", "TIFF"])
def test_cmyk(put: Callable[[bytes], Path], format_: str) -> None:
    # JPEG stores it inverted, as Adobe's programs do; TIFF does not.
    decoded = decode_photo(put(encoded(format_, Image.new("CMYK", (16, 16), (255, 0, 0, 0)))))
    assert np.abs(decoded.astype(int) - [0, 255, 255]).max() <= 3


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("channels", [1, 3])
def test_sixteen_bits_are_scaled(tmp_path: Path, suffix: str, channels: int) -> None:
    deep = np.linspace(0, 65535, 32 * 8).reshape(8, 32).astype(np.uint16)
    deep = deep if channels == 1 else np.stack([deep] * 3, axis=-1)
    path = tmp_path / f"deep{suffix}"
    assert cv2.imwrite(str(path), deep)
    expected = deep.reshape(8, 32, channels)[..., :1] / 257.0
    assert np.abs(decode_photo(path) - expected).max() <= 1


@pytest.mark.parametrize("mode", ["L", "1", "LA", "I;16"])
def test_grey_has_three_equal_channels(put: Callable[[bytes], Path], mode: str) -> None:
    grey = Image.fromarray(IMAGE[..., 0])
    image = (
        grey.convert("I").point(lambda v: v * 257).convert("I;16") if mode == "I;16" else grey.convert(mode)
    )
    decoded = decode_photo(put(encoded("PNG", image)))
    assert (decoded == decoded[..., :1]).all() and decoded.std() > 20


def test_twelve_megapixels_keep_their_size(put: Callable[[bytes], Path]) -> None:
    path = put(encoded("JPEG", Image.new("RGB", (4032, 3024), (90, 140, 60))))
    assert decode_photo(path).shape == (3024, 4032, 3)


def claim(width: int, height: int) -> bytes:
    """A PNG whose header claims `width` x `height` pixels and whose data hold almost none."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + data + chunk(b"IEND", b"")


@pytest.mark.parametrize("side", [14500, 16000, 60000])
@pytest.mark.parametrize("read", [decode_photo, decode_mask, read_upright_size])
def test_decompression_bombs_are_refused_by_their_header(
    put: Callable[[bytes], Path], monkeypatch: pytest.MonkeyPatch, side: int, read: Callable[[Path], object]
) -> None:
    assert side**2 > MAX_PIXELS
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", lambda *_: pytest.fail("pixels were decoded"))
    with pytest.raises(InputError, match="200 megapixels"):
        read(put(claim(side, side)))


BAD = {
    "empty": (b"", "empty"),
    "text": (b"not an image at all", "not an image"),
    "script": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "not an image"),
    "heic": (b"\0\0\0\x18ftypheic" + bytes(40), "HEIC"),
    "cut jpeg": (encoded("JPEG")[:400], "cannot be decoded"),
    "cut png": (encoded("PNG")[:60], "cannot be decoded"),
    "cut tiff": (encoded("TIFF")[:200], "cannot be decoded|not an image"),
    "floating point": (encoded("TIFF", Image.new("F", (4, 4))), "floating-point"),
}


@pytest.mark.parametrize(("content", "message"), BAD.values(), ids=BAD)
def test_bad_files(put: Callable[[bytes], Path], content: bytes, message: str) -> None:
    path = put(content)
    with pytest.raises(InputError, match=message) as raised:
        decode_photo(path)
    assert str(path) in str(raised.value) and ";" in str(raised.value)


def test_folders_and_missing_files_are_refused(tmp_path: Path) -> None:
    for path, message in [
        (tmp_path, "folder"),
        (tmp_path / "none.jpg", "file not found"),
        (Path("/dev/null"), "file not found"),
    ]:
        with pytest.raises(InputError, match=message):
            decode_photo(path)
    with pytest.raises(InputError):
        decode_photo("nul\0.jpg")


def test_unreadable_file_says_why(put: Callable[[bytes], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(encoded("PNG"))

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Image, "open", refuse)
    with pytest.raises(InputError, match=r"cannot read .*: Permission denied"):
        decode_photo(path)


@pytest.mark.parametrize("white", [1, 255])
def test_masks_of_any_brightness(put: Callable[[bytes], Path], white: int) -> None:
    true = IMAGE[..., 0] > 100
    assert np.array_equal(
        decode_mask(put(encoded("PNG", Image.fromarray(true.astype(np.uint8) * white)))), true
    )


def test_masks_of_one_bit_or_with_transparency(put: Callable[[bytes], Path]) -> None:
    true = IMAGE[..., 0] > 100
    assert np.array_equal(decode_mask(put(encoded("PNG", Image.fromarray(true)))), true)
    cut_out = np.dstack([np.full((*true.shape, 3), 255, np.uint8), true.astype(np.uint8) * 255])
    assert np.array_equal(decode_mask(put(encoded("PNG", Image.fromarray(cut_out)))), true)


def test_empty_mask(put: Callable[[bytes], Path]) -> None:
    with pytest.raises(InputError, match="no leaf"):
        decode_mask(put(encoded("PNG", Image.new("L", (8, 8)))))


WHOLE = [encoded(format_) for format_ in ("JPEG", "PNG", "TIFF", "GIF", "WEBP", "BMP")]
WHOLE += [encoded("TIFF", compression="tiff_lzw"), encoded("JPEG", progressive=True)]
fuzz = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def decodes_or_says_why(path: Path) -> None:
    for read in (decode_photo, decode_mask, read_upright_size):
        try:
            read(path)
        except InputError as error:
            assert "\n" not in str(error) and "image" in str(error)


@fuzz
@given(
    content=st.binary(max_size=300),
    start=st.sampled_from([b"", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"II*\0"]),
)
def test_random_bytes_raise_nothing_else(put: Callable[[bytes], Path], content: bytes, start: bytes) -> None:
    decodes_or_says_why(put(start + content))


@fuzz
@given(whole=st.sampled_from(WHOLE), data=st.data())
def test_damaged_files_raise_nothing_else(
    put: Callable[[bytes], Path], whole: bytes, data: st.DataObject
) -> None:
    content = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for _ in range(data.draw(st.integers(0, 3)) if content else 0):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    decodes_or_says_why(put(bytes(content)))
