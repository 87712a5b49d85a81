"""Photos as people name them: pages of a TIFF, folders of all formats, URLs, files without permission."""

import csv
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from corpus_pictures import draw
from make_corpus import CORPUS
from PIL import Image

from laesi_tf import predict as command
from laesi_tf.common.errors import InputError
from laesi_tf.data import decoding, tiff_photo
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.photo_pages import list_pages
from laesi_tf.estimators import factory
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo


class Mean:
    """An estimator whose area is the mean of the photo."""

    def measure(self, image: np.ndarray, info: PhotoInfo = UNKNOWN) -> Measurement:
        return Measurement(method="mean", leaves=(LeafMeasurement(area_cm2=float(image.mean())),))


@pytest.fixture(autouse=True)
def mean_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factory, "load_estimator", lambda *_, **__: Mean())


def predict(out: Path, *arguments: object) -> dict[str, dict[str, str]]:
    """Return the rows of areas.csv by the names of their photos."""
    command.main([*map(str, arguments), "--out", str(out)])
    with (out / "areas.csv").open(newline="") as file:
        return {Path(row["photo"]).name: row for row in csv.DictReader(file)}


def test_each_page_is_measured_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pages = [Image.new("RGB", (60, 40), (grey, grey, grey)) for grey in (255, 100, 50)]
    pages[0].save(tmp_path / "scan.tif", save_all=True, append_images=pages[1:])
    rows = predict(tmp_path / "out", tmp_path / "scan.tif")
    assert {name: float(row["area_cm2"]) for name, row in rows.items()} == {
        "scan.tif#1": 255,
        "scan.tif#2": 100,
        "scan.tif#3": 50,
    }
    assert [row["overlay"] for row in rows.values()] == [
        f"scan-page{number}.overlay.jpg" for number in (1, 2, 3)
    ]
    assert all((tmp_path / "out" / row["overlay"]).is_file() for row in rows.values())
    assert "scan.tif#2" in capsys.readouterr().out


def test_a_damaged_page_is_refused_and_the_others_are_measured(tmp_path: Path) -> None:
    pages = [Image.new("RGB", (60, 40), "white") for _ in range(3)]
    pages[0].save(tmp_path / "scan.tif", save_all=True, append_images=pages[1:])
    content = bytearray((tmp_path / "scan.tif").read_bytes())
    # The width of the second page.
    first = content.index(struct.pack("<HHII", 256, 4, 1, 60))
    second = content.index(struct.pack("<HHII", 256, 4, 1, 60), first + 1)
    content[second + 8 : second + 12] = struct.pack("<I", 60_000_000)
    (tmp_path / "scan.tif").write_bytes(content)
    rows = predict(tmp_path / "out", tmp_path / "scan.tif")
    assert "200 megapixels" in rows["scan.tif#2"]["error"]
    assert rows["scan.tif#1"]["area_cm2"] and rows["scan.tif#3"]["area_cm2"]


def test_a_cut_file_says_so_after_its_whole_pages(tmp_path: Path) -> None:
    content = (CORPUS / "two_pages.tif").read_bytes()
    (tmp_path / "scan.tif").write_bytes(content[: len(content) // 2 + 50])
    rows = predict(tmp_path / "out", tmp_path / "scan.tif")
    assert rows["scan.tif#1"]["area_cm2"] and "cannot be decoded as TIFF" in rows["scan.tif#2"]["error"]


def test_a_file_of_too_many_pages_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (tiff_photo, decoding):
        monkeypatch.setattr(module, "MAX_IMAGES", 2)
    pages = [Image.new("L", (6, 4), 9) for _ in range(5)]
    pages[0].save(tmp_path / "scan.tif", save_all=True, append_images=pages[1:])
    rows = predict(tmp_path / "out", tmp_path / "scan.tif")
    assert list(rows) == ["scan.tif#1", "scan.tif#2", "scan.tif#3"]
    assert "more than 2 images; split it" in rows["scan.tif#3"]["error"]


def test_nothing_in_a_folder_is_passed_over(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    names = ["messenger.jfif", "camera_10_bit.hif", "phone.heic", "avif.avif", "camera.cr3", "jpeg_xl.jxl"]
    for name in names:
        shutil.copy(CORPUS / name, folder / name.upper())
    (folder / "notes.txt").write_text("no photo")
    rows = predict(tmp_path / "out", folder)
    assert sorted(rows) == sorted(name.upper() for name in names)
    refused = {name: row["error"] for name, row in rows.items() if row["error"]}
    assert sorted(refused) == ["CAMERA.CR3", "JPEG_XL.JXL"]
    assert "Canon CR3" in refused["CAMERA.CR3"] and "JPEG XL" in refused["JPEG_XL.JXL"]


@pytest.mark.parametrize("address", ["https://example.org/leaf.jpg", "file:///home/leaf.jpg"])
def test_addresses_are_refused_as_they_are_given(address: str, tmp_path: Path) -> None:
    for read in (decode_photo, decode_mask, lambda text: command.main([text, "--out", str(tmp_path)])):
        with pytest.raises(InputError, match=f"^{address} is a URL, and URLs are not opened; "):
            read(address)


def test_an_empty_argument_is_not_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(CORPUS / "png.png", tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="'' names nothing; name a photo"):
        command.main([""])
    with pytest.raises(InputError, match="name a photo"):
        decode_photo("")


def test_a_missing_permission_is_no_reason_to_save_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    path = CORPUS / "png.png"
    with pytest.raises(InputError) as raised:
        decode_photo(path)
    message = str(raised.value)
    assert message.startswith(f"cannot read {path}: Permission denied; ")
    assert "chmod" in message and "save" not in message and "copy" not in message
    assert [str(page) for page in list_pages(path)] == [str(path)]


def test_photos_of_200_megapixels_are_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # In the proportions of Pillow's limit to ours, with a thousandth of the pixels.
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 89_478)
    monkeypatch.setattr(decoding, "MAX_PIXELS", 200_000)
    for suffix in ("jpg", "png", "tif"):
        Image.new("RGB", (499, 400), (90, 140, 60)).save(tmp_path / f"large.{suffix}")
        assert decode_photo(tmp_path / f"large.{suffix}").shape == (400, 499, 3)
        Image.new("RGB", (501, 400)).save(tmp_path / f"huge.{suffix}")
        with pytest.raises(InputError, match="501 x 400 pixels, more than the limit"):
            decode_photo(tmp_path / f"huge.{suffix}")
    assert Image.MAX_IMAGE_PIXELS == 89_478


def test_large_photos_are_converted_in_groups_of_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("laesi_tf.data.image_rows._PIXELS", 200)
    for name in (
        "png.png",
        "orientation5.png",
        "orientation6.jpeg",
        "orientation6.tiff",
        "rgb12_in_16_big.tif",
    ):
        image = decode_photo(CORPUS / name)
        assert np.abs(image.astype(int) - draw("picture")).mean() <= 5, name
