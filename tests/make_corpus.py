"""Make the small files of tests/corpus, one for each format and oddity, and their list corpus.csv.

`python tests/make_corpus.py` writes all of them anew. Encoders change with their versions, so commit the
files together with the list, which has their hashes. The column `shows` names what `draw` returns for a file;
for a file that must be refused, the column `refusal` has words of the message.
"""

import csv
import hashlib
import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pillow_heif
import tifffile
from corpus_pictures import Pixels, alpha, deep, draw, draw_picture, oriented
from icc_profiles import (
    ADOBE_GAMMA,
    ADOBE_PRIMARIES,
    P3_PRIMARIES,
    cmyk_profile,
    encode,
    grey_profile,
    rgb_profile,
)
from numpy.typing import NDArray
from PIL import Image

CORPUS = Path(__file__).parent / "corpus"
LIST = CORPUS / "corpus.csv"


@dataclass(frozen=True)
class Entry:
    """A file of the corpus and what must become of it."""

    name: str
    content: bytes
    shows: str = ""
    """picture, grey, two_tone, cut_out or inks: see `draw`."""
    tolerance: int = 0
    """Largest mean difference of a channel from what the file shows."""
    refusal: str = ""


def save(image: Image.Image | Pixels, format_: str, **options: object) -> bytes:
    """Return the file that Pillow makes of `image`."""
    buffer = io.BytesIO()
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(buffer, format_, **options)
    return buffer.getvalue()


def save_tiff(image: NDArray, **options: object) -> bytes:
    """Return the TIFF that tifffile makes of `image`."""
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, image, metadata=None, software=False, **options)
    return buffer.getvalue()


def browser_formats() -> Iterator[Entry]:
    """Yield JPEG, PNG, GIF, BMP, WebP and AVIF."""
    picture = draw_picture()
    cut_out = np.dstack([picture, alpha()])
    yield Entry("jpeg.jpg", save(picture, "JPEG", quality=95), "picture", 4)
    yield Entry("progressive.jpe", save(picture, "JPEG", progressive=True), "picture", 8)
    yield Entry("grey.jpeg", save(draw("grey")[..., 0], "JPEG", quality=95), "grey", 4)
    yield Entry("messenger.jfif", save(picture, "JPEG"), "picture", 8)
    inks = Image.fromarray(255 - picture).convert("RGB")
    cmyk = Image.merge("CMYK", (*inks.split(), Image.new("L", inks.size)))
    yield Entry("cmyk.jpg", save(cmyk, "JPEG", quality=95), "picture", 6)
    small = Image.new("RGB", (12, 8), (90, 90, 90))
    options = {"save_all": True, "append_images": [small], "quality": 95}
    yield Entry("phone.mpo", save(Image.fromarray(picture), "MPO", **options), "picture", 4)
    gain = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><hdrgm:Version xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/"/>'
    options |= {"xmp": gain + b"</x:xmpmeta>"}
    yield Entry("ultra_hdr.jpg", save(Image.fromarray(picture), "MPO", **options), "picture", 4)
    yield Entry("png.png", save(picture, "PNG"), "picture")
    yield Entry("alpha.png", save(cut_out, "PNG"), "cut_out")
    yield Entry("palette.png", save(Image.fromarray(picture).quantize(256), "PNG"), "picture", 8)
    yield Entry(
        "one_bit.png", save(Image.fromarray(draw("two_tone")[..., 0]).convert("1"), "PNG"), "two_tone"
    )
    for name, image in (("grey16.png", deep(16)), ("rgb16.png", deep(16, colour=True)[..., ::-1])):
        yield Entry(
            name, cv2.imencode(".png", image)[1].tobytes(), "grey" if image.ndim == 2 else "picture", 1
        )
    yield Entry("gif.gif", save(Image.fromarray(picture).quantize(256), "GIF"), "picture", 8)
    yield Entry("bmp.bmp", save(picture, "BMP"), "picture")
    yield Entry("webp.webp", save(picture, "WEBP", quality=95), "picture", 6)
    yield Entry("alpha.webp", save(cut_out, "WEBP", lossless=True), "cut_out")
    yield Entry("avif.avif", save(picture, "AVIF", quality=95), "picture", 6)
    yield Entry("alpha.avif", save(cut_out, "AVIF", quality=95, subsampling="4:4:4"), "cut_out", 6)
    yield Entry("jpeg_named.png", save(picture, "JPEG", quality=95), "picture", 4)
    yield Entry("png_named.jpg", save(picture, "PNG"), "picture")
    yield Entry("jpeg_named.dng", save(picture, "JPEG", quality=95), "picture", 4)
    for orientation in (5, 6):
        image, exif = oriented(orientation)
        for format_, tolerance in (("JPEG", 6), ("PNG", 0), ("TIFF", 0), ("WEBP", 6), ("AVIF", 8)):
            content = save(image, format_, exif=exif)
            yield Entry(f"orientation{orientation}.{format_.lower()}", content, "picture", tolerance)


def heif() -> Iterator[Entry]:
    """Yield HEIC and HEIF as phones and cameras write them."""
    pillow_heif.register_heif_opener()
    picture = draw_picture()
    options = {"quality": 95, "chroma": 444}
    yield Entry("phone.heic", save(picture, "HEIF", quality=90), "picture", 8)
    yield Entry("tiles.heic", save(picture, "HEIF", tile_size=16, **options), "picture", 6)
    yield Entry("alpha.heif", save(np.dstack([picture, alpha()]), "HEIF", **options), "cut_out", 6)
    size = picture.shape[1::-1]
    buffer = io.BytesIO()
    ten_bit = pillow_heif.from_bytes("RGB;16", size, deep(16, colour=True).tobytes())
    ten_bit.save(buffer, **options)
    yield Entry("camera_10_bit.hif", buffer.getvalue(), "picture", 6)
    # A phone stores the orientation twice, as a property that the decoder applies and in EXIF.
    for orientation in (5, 6):
        image, exif = oriented(orientation)
        content = save(image, "HEIF", exif=exif.tobytes(), **options)
        yield Entry(f"orientation{orientation}.heic", content, "picture", 6)
    # Without the property, EXIF's orientation is void.
    content = save(picture, "HEIF", exif=oriented(6)[1], **options)
    yield Entry("void_orientation.heic", content, "picture", 6)
    p3 = encode(picture, P3_PRIMARIES, None)
    content = save(p3, "HEIF", icc_profile=rgb_profile(P3_PRIMARIES, gamma=None), **options)
    yield Entry("display_p3.heic", content, "picture", 6)
    whole = save(picture, "HEIF")
    yield Entry("cut.heic", whole[: len(whole) // 2], refusal="cannot be decoded as HEIC")
    claim = whole.index(b"ispe") + 8
    bomb = whole[:claim] + struct.pack(">II", 30000, 30000) + whole[claim + 8 :]
    yield Entry("bomb.heic", bomb, refusal="200 megapixels")


def profiles() -> Iterator[Entry]:
    """Yield files with ICC profiles."""
    picture = draw_picture()
    p3, adobe = rgb_profile(P3_PRIMARIES, gamma=None), rgb_profile(ADOBE_PRIMARIES, gamma=ADOBE_GAMMA)
    pixels = encode(picture, P3_PRIMARIES, None)
    yield Entry(
        "display_p3.jpg", save(pixels, "JPEG", quality=97, subsampling=0, icc_profile=p3), "picture", 4
    )
    yield Entry("display_p3.png", save(pixels, "PNG", icc_profile=p3), "picture", 1)
    yield Entry("display_p3.avif", save(pixels, "AVIF", quality=97, icc_profile=p3), "picture", 6)
    pixels = encode(picture, ADOBE_PRIMARIES, ADOBE_GAMMA)
    yield Entry("adobe_rgb.tif", save(pixels, "TIFF", icc_profile=adobe), "picture", 1)
    linear = np.round(255 * (draw("grey")[..., 0] / 255) ** (2.2 / 1.8)).astype(np.uint8)
    yield Entry("grey_gamma.png", save(linear, "PNG", icc_profile=grey_profile(1.8)), "grey", 4)
    lab = np.zeros((2, 2, 2, 2, 3))
    lab[0, 0, 0, 0], lab[1, 0, 0, 0] = (100, 0, 0), (55, -37, -50)
    cyan = Image.new("CMYK", (48, 32), (255, 0, 0, 0))
    yield Entry("inks.tif", save(cyan, "TIFF", icc_profile=cmyk_profile(lab)), "inks", 2)
    yield Entry("broken_profile.png", save(picture, "PNG", icc_profile=p3[:200]), "picture")
    yield Entry("profile_of_cmyk.png", save(picture, "PNG", icc_profile=cmyk_profile(lab)), "picture")


def tiff() -> Iterator[Entry]:
    """Yield TIFF as scanners, microscopes and image editors write it."""
    picture, grey = draw_picture(), draw("grey")[..., 0]
    image = Image.fromarray(picture)
    for compression in ("tiff_lzw", "tiff_adobe_deflate", "packbits"):
        yield Entry(
            f"{compression.removeprefix('tiff_')}.tif",
            save(image, "TIFF", compression=compression),
            "picture",
        )
    yield Entry("jpeg.tiff", save(image, "TIFF", compression="jpeg", quality=95), "picture", 6)
    fax = Image.fromarray(draw("two_tone")[..., 0]).convert("1")
    yield Entry("fax.tif", save(fax, "TIFF", compression="group4"), "two_tone")
    yield Entry("palette.tif", save(image.quantize(256), "TIFF"), "picture", 8)
    inks = Image.fromarray(255 - picture)
    yield Entry(
        "cmyk.tif",
        save(Image.merge("CMYK", (*inks.split(), Image.new("L", inks.size))), "TIFF"),
        "picture",
        1,
    )
    yield Entry("alpha.tif", save(np.dstack([picture, alpha()]), "TIFF"), "cut_out")
    yield Entry("big.tif", save_tiff(picture, photometric="rgb", bigtiff=True), "picture")
    yield Entry("tiles.tif", save_tiff(picture, photometric="rgb", tile=(16, 16)), "picture")
    yield Entry("inverted8.tif", save_tiff(255 - grey, photometric="miniswhite"), "grey")
    for order, name in (("<", "little"), (">", "big")):
        yield Entry(f"grey16_{name}.tif", save_tiff(deep(16), byteorder=order), "grey", 1)
        inverted = save_tiff(65535 - deep(16), byteorder=order, photometric="miniswhite")
        yield Entry(f"inverted16_{name}.tif", inverted, "grey", 1)
        colour = save_tiff(deep(16, colour=True), byteorder=order, photometric="rgb")
        yield Entry(f"rgb16_{name}.tif", colour, "picture", 1)
        planes = deep(16, colour=True).transpose(2, 0, 1).copy()
        planar = save_tiff(planes, byteorder=order, photometric="rgb", planarconfig="separate")
        yield Entry(f"planes16_{name}.tif", planar, "picture", 1)
        twelve = save_tiff(deep(12, colour=True), byteorder=order, photometric="rgb")
        yield Entry(f"rgb12_in_16_{name}.tif", twelve, "picture", 1)
    for bits in (10, 12, 14):
        yield Entry(f"grey{bits}_in_16.tif", save_tiff(deep(bits)), "grey", 1)
    yield Entry("inverted12_in_16.tif", save_tiff(4095 - deep(12), photometric="miniswhite"), "grey", 1)
    packed = cv2.imencode(".tif", deep(12, colour=True)[..., ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, 5])[1]
    yield Entry("rgb12_in_16_lzw.tif", packed.tobytes(), "picture", 1)
    yield Entry(
        "two_pages.tif", save(image, "TIFF", save_all=True, append_images=[image.rotate(180)]), "picture"
    )
    for name, steps in (("with_thumbnail", (1, 4)), ("after_thumbnail", (4, 1))):
        buffer = io.BytesIO()
        with tifffile.TiffWriter(buffer) as writer:
            for step in steps:
                options = {"photometric": "rgb", "subfiletype": int(step > 1), "metadata": None}
                writer.write(picture[::step, ::step].copy(), software=False, **options)
        yield Entry(f"{name}.tif", buffer.getvalue(), "picture")
    yield Entry("floating_point.tif", save_tiff(grey.astype(np.float32)), refusal="floating-point")
    yield Entry("grey32.tif", save_tiff(grey.astype(np.uint32) * 2**23), refusal="more than 16 bits")


def raw() -> Iterator[Entry]:
    """Yield beginnings of raw files, with previews where Pillow would open them."""
    preview = draw_picture()[::2, ::2].copy()
    options = {"photometric": "rgb", "subfiletype": 1}
    dng = save_tiff(preview, extratags=[(50706, "B", 4, (1, 4, 0, 0), True)], **options)
    yield Entry("phone.dng", dng, refusal="raw file (DNG)")
    yield Entry("dng_named.tif", dng, refusal="raw file, which")
    for suffix, name in (
        ("nef", "Nikon NEF"),
        ("arw", "Sony ARW"),
        ("pef", "Pentax PEF"),
        ("srw", "Samsung SRW"),
    ):
        yield Entry(f"camera.{suffix}", save_tiff(preview, **options), refusal=f"raw file ({name})")
    sub_images = io.BytesIO()
    with tifffile.TiffWriter(sub_images) as writer:
        writer.write(preview, subifds=1, metadata=None, software=False, **options)
        writer.write(deep(12), photometric="minisblack", metadata=None, software=False)
    yield Entry("nef_named.tif", sub_images.getvalue(), refusal="raw file, which")
    tail = bytes(100)
    yield Entry("camera.cr2", b"II*\0\x10\0\0\0CR\x02\0" + tail, refusal="raw file (Canon CR2)")
    yield Entry("camera.cr3", b"\0\0\0\x18ftypcrx \0\0\0\1crx isom" + tail, refusal="raw file (Canon CR3)")
    yield Entry("camera.orf", b"IIRO\x08\0\0\0" + tail, refusal="raw file (Olympus ORF)")
    yield Entry("camera.rw2", b"IIU\0\x08\0\0\0" + tail, refusal="raw file (Panasonic RW2)")
    yield Entry("camera.raf", b"FUJIFILMCCD-RAW 0201" + tail, refusal="raw file (Fujifilm RAF)")
    yield Entry("unknown.kdc", b"EASTMAN" + tail, refusal="raw file (Kodak KDC)")


def refused() -> Iterator[Entry]:
    """Yield files of other formats, damaged files and decompression bombs."""
    jpeg, tail = save(draw_picture(), "JPEG"), bytes(100)
    yield Entry("jpeg_xl.jxl", b"\0\0\0\x0cJXL \r\n\x87\n" + tail, refusal="a JPEG XL file")
    yield Entry("codestream.jxl", b"\xff\x0a" + tail, refusal="a JPEG XL file")
    yield Entry("jpeg_2000.jp2", b"\0\0\0\x0cjP  \r\n\x87\n" + tail, refusal="a JPEG 2000 file")
    yield Entry("scanner.pdf", b"%PDF-1.4\n" + tail, refusal="a PDF")
    yield Entry("editor.psd", b"8BPS\0\1" + tail, refusal="a Photoshop file")
    yield Entry("live_photo.heic", b"\0\0\0\x14ftypqt  \0\0\0\0qt  " + tail, refusal="a video")
    yield Entry("text.jpg", b"not an image\n", refusal="not an image in a known format")
    yield Entry("empty.jpg", b"", refusal="is empty")
    yield Entry("cut.jpg", jpeg[: len(jpeg) // 2], refusal="cannot be decoded")
    png = save(draw_picture(), "PNG")
    header = struct.pack(">II", 20000, 20000) + png[24:29]
    bomb = png[:16] + header + struct.pack(">I", zlib.crc32(b"IHDR" + header)) + png[33:]
    yield Entry("bomb.png", bomb, refusal="200 megapixels")
    tiff_ = save(draw_picture(), "TIFF")
    width = tiff_.index(struct.pack("<HHII", 256, 4, 1, 48)) + 8
    height = tiff_.index(struct.pack("<HHII", 257, 4, 1, 32)) + 8
    bomb = bytearray(tiff_)
    bomb[width : width + 4] = bomb[height : height + 4] = struct.pack("<I", 19000)
    yield Entry("bomb.tif", bytes(bomb), refusal="200 megapixels")


def main() -> None:
    """Write the corpus."""
    CORPUS.mkdir(exist_ok=True)
    entries = [*browser_formats(), *heif(), *profiles(), *tiff(), *raw(), *refused()]
    with LIST.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("file", "sha256", "shows", "tolerance", "refusal"))
        for entry in entries:
            (CORPUS / entry.name).write_bytes(entry.content)
            digest = hashlib.sha256(entry.content).hexdigest()
            writer.writerow(
                (entry.name, digest, entry.shows, entry.tolerance if entry.shows else "", entry.refusal)
            )


if __name__ == "__main__":
    main()
