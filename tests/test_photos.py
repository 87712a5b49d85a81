"""Manifests: what they say, what they may not say, and the training source made of their photos."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from green import disk, photo
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from laesi_tf.common.errors import InputError
from laesi_tf.data import synthetic
from laesi_tf.data.decoding import read_upright_size
from laesi_tf.data.manifest import read_manifest
from laesi_tf.data.photo_dataset import IndexedSamples, load_into_memory, stream_from_disk

Write = Callable[[str | bytes], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A folder with photos a.png (60 x 40) and b.png (40 x 40), their masks, and the manifest to write."""
    folder = tmp_path / "set"
    for name, size in {"a": (40, 60), "b": (40, 40)}.items():
        (folder / "masks").mkdir(parents=True, exist_ok=True)
        Image.fromarray(photo(*size)).save(folder / f"{name}.png")
        Image.fromarray(disk(*size)).save(folder / "masks" / f"{name}.png")
    Image.fromarray(photo(40, 40)).save(tmp_path / "outside.png")

    def manifest(content: str | bytes) -> Path:
        path = folder / "manifest.csv"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return manifest


def test_every_column(write: Write) -> None:
    path = write(
        "species,image,area_cm2,mask,px_per_mm,grid_mm,split,subset,note\n"
        "beech,a.png,12.5,masks/a.png,4.5,5,test,easy,whatever\noak,b.png,3,,,,,,\n"
    )
    first, second = read_manifest(path)
    assert (first.name, first.image, first.mask) == (
        "a.png",
        path.parent / "a.png",
        path.parent / "masks/a.png",
    )
    assert (first.area_cm2, first.px_per_mm, first.grid_mm) == (12.5, 4.5, 5.0)
    assert (first.split, first.subset, first.species) == ("test", "easy", "beech")
    assert (second.mask, second.px_per_mm, second.grid_mm, second.split) == (None, None, 1.0, None)


def test_split_is_chosen(write: Write) -> None:
    path = write("image,area_cm2,split\na.png,1,train\nb.png,2,test\n")
    assert [one.name for one in read_manifest(path, split="test")] == ["b.png"]
    with pytest.raises(InputError, match=r"'val'.*its splits: test, train"):
        read_manifest(path, split="val")


@pytest.mark.parametrize(
    "content",
    [
        "\ufeffimage,area_cm2\r\na.png,12.5\r\n",
        "image;area_cm2\na.png;12,5\n",
        ' image , area_cm2\n"a.png", 12.5\n\n,\n',
        "image,area_cm2\n./a.png,12.5\n",
        "image,area_cm2\n.\\a.png,12.5\n",
    ],
    ids=["excel", "semicolons and decimal commas", "spaces and blank lines", "dot", "backslash"],
)
def test_spellings(write: Write, content: str) -> None:
    (only,) = read_manifest(write(content))
    assert only.area_cm2 == 12.5 and only.image.samefile(only.image.parent / "a.png")


def test_missing_files_are_left_to_whoever_decodes_them(write: Write) -> None:
    photos = read_manifest(write("image,area_cm2,mask\na.png,1,masks/c.png\nc.png,1,\nmasks,1,\n"))
    assert [photo.name for photo in photos] == ["a.png", "c.png", "masks"]


BAD = {
    "empty": ("", "no single column 'image'"),
    "no column": ("image,area\na.png,1\n", "no single column 'area_cm2'"),
    "column twice": ("image,area_cm2,image\na.png,1,b.png\n", "no single column 'image'"),
    "no row": ("image,area_cm2\n", "lists no photo"),
    "no image": ("image,area_cm2\n,1\n", "line 2: image is not a path"),
    "zero area": ("image,area_cm2\na.png,0\n", "line 2: area_cm2 is '0'"),
    "negative area": ("image,area_cm2\na.png,-3\n", "line 2: area_cm2 is '-3'"),
    "nan area": ("image,area_cm2\na.png,nan\n", "line 2: area_cm2 is 'nan'"),
    "infinite area": ("image,area_cm2\na.png,inf\n", "line 2: area_cm2 is 'inf'"),
    "decimal comma": ("image,area_cm2\na.png,31,9\n", "line 2 has more cells than the header"),
    "wordy area": ("image,area_cm2\na.png,large\n", "line 2: area_cm2 is 'large'"),
    "no area": ("image,area_cm2\na.png\n", "line 2: area_cm2 is ''"),
    "zero scale": ("image,area_cm2,px_per_mm\na.png,1,0\n", "line 2: px_per_mm is '0'"),
    "negative grid": ("image,area_cm2,grid_mm\na.png,1,-1\n", "line 2: grid_mm is '-1'"),
    "other mask": (
        "image,area_cm2,mask\na.png,1,masks/b.png\n",
        "line 2: mask is 40 x 40 pixels but its image 60 x 40",
    ),
    "twice": ("image,area_cm2\na.png,1\nb.png,1\n./a.png,2\n", "line 4: image './a.png' stands in line 2"),
    "above": ("image,area_cm2\n../outside.png,1\n", "line 2: .*leaves the manifest's folder"),
    "above by backslash": ("image,area_cm2\n..\\outside.png,1\n", "line 2: .*leaves the manifest's folder"),
    "absolute": ("image,area_cm2\n/etc/passwd,1\n", "line 2: .*leaves the manifest's folder"),
    "drive": ("image,area_cm2\nC:\\a.png,1\n", "line 2: .*leaves the manifest's folder"),
    "mask above": (
        "image,area_cm2,mask\na.png,1,../outside.png\n",
        "line 2: mask .*leaves the manifest's folder",
    ),
    "link": ("image,area_cm2\nlink.png,1\n", "line 2: .*leaves the manifest's folder"),
    "open quote": ('image,area_cm2\n"a.png,1\n', "not a CSV file"),
    "latin": ("image,area_cm2\nä.png,1\n".encode("latin-1"), "not UTF-8"),
    "a picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "not UTF-8"),
}


@pytest.mark.parametrize(("content", "message"), BAD.values(), ids=BAD)
def test_bad_manifests(write: Write, content: str | bytes, message: str) -> None:
    path = write(content)
    (path.parent / "link.png").symlink_to(path.parent.parent / "outside.png")
    with pytest.raises(InputError, match=message) as raised:
        read_manifest(path)
    assert str(path) in str(raised.value) and ";" in str(raised.value)


def test_mask_is_compared_with_the_upright_image(write: Write) -> None:
    path = write("image,area_cm2,mask\nturned.jpg,1,masks/a.png\n")
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(photo(60, 40)).save(path.parent / "turned.jpg", exif=exif)
    assert len(read_manifest(path)) == 1


def test_what_is_no_manifest(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none.csv"):
        with pytest.raises(InputError, match="cannot read manifest"):
            read_manifest(path)


ANY_BYTES = st.binary(max_size=200)
ANY_ROWS = st.text(st.sampled_from('image,area_cm2;"\n\r\t\0ä.png/..\\ 0123-eE'), max_size=120)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=ANY_BYTES
    | ANY_ROWS.map(str.encode)
    | ANY_ROWS.map(lambda rows: f"image,area_cm2,mask\n{rows}".encode())
)
def test_any_text_is_read_or_refused(write: Write, content: bytes) -> None:
    path = write(content)
    try:
        photos = read_manifest(path)
    except InputError as error:
        assert str(path) in str(error)
    else:
        assert all(one.image.resolve().is_relative_to(path.parent.resolve()) for one in photos)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(area=st.floats(1e-6, 1e6), subset=st.text(st.characters(categories=("L", "N")), max_size=20))
def test_values_survive(write: Write, area: float, subset: str) -> None:
    (only,) = read_manifest(write(f"image,area_cm2,subset\na.png,{area!r},{subset}\n"))
    assert only.area_cm2 == area and only.subset == (subset or None)


def at(pictures: IndexedSamples, index: int) -> dict[str, np.ndarray]:
    return {name: value.numpy() for name, value in pictures.at(tf.constant(index, tf.int64)).items()}


@pytest.fixture(params=["held", "streamed"])
def opened(request: pytest.FixtureRequest) -> Callable[..., IndexedSamples]:
    """Either way to hold photos, taken from a manifest."""

    def open_(path: Path, *, masked: bool = False) -> IndexedSamples:
        photos = read_manifest(path)
        if request.param == "streamed":
            return stream_from_disk(photos, size=(32, 32), masked=masked)
        return load_into_memory(photos, size=(32, 32), masked=masked)[0]

    return open_


def test_pictures_are_the_photos_in_order(write: Write, opened: Callable[..., IndexedSamples]) -> None:
    pictures = opened(write("image,area_cm2\na.png,12.5\nb.png,3\n"))
    assert pictures.count == 2
    found = [at(pictures, index) for index in (0, 1)]
    assert [float(picture["area_cm2"]) for picture in found] == [12.5, 3.0]
    for picture in found:
        assert np.isnan(picture["px_per_mm"]) and not picture["mask"].any()
        assert picture["image"].shape == (32, 32, 3) and picture["image"].dtype == np.uint8
        assert np.isnan(synthetic.make_target(picture, "area").numpy()[1:]).all()


def test_pictures_know_the_factors_of_the_area(write: Write, opened: Callable[..., IndexedSamples]) -> None:
    path = write("image,area_cm2,mask,px_per_mm\nb.png,3,masks/b.png,4\n")
    picture = at(opened(path, masked=True), 0)
    green = picture["image"][..., 1].astype(int) - picture["image"][..., 0] > 60
    assert picture["mask"].dtype == np.uint8 and (green != picture["mask"].astype(bool)).mean() < 0.02
    (photo,) = read_manifest(path)
    assert picture["px_per_mm"] == pytest.approx(4 * 32 / max(read_upright_size(photo.image)))
    share = synthetic.make_target(picture, "area").numpy()[2]
    assert share == pytest.approx(green.mean(), abs=0.02)


def test_what_is_left_out_is_named(write: Write) -> None:
    path = write("image,area_cm2\na.png,12.5\ncut.png,5\nb.png,3\n")
    (path.parent / "cut.png").write_bytes((path.parent / "a.png").read_bytes()[:70])
    pictures, skipped = load_into_memory(read_manifest(path), size=(32, 32), masked=False)
    assert [one.name for one in skipped] == ["cut.png"] and "cannot be decoded" in skipped[0].reason
    assert [float(at(pictures, index)["area_cm2"]) for index in range(pictures.count)] == [12.5, 3.0]


def test_a_streamed_photo_that_is_bad_gives_way_to_the_next(write: Write) -> None:
    path = write("image,area_cm2\na.png,12.5\ncut.png,5\nb.png,3\n")
    (path.parent / "cut.png").write_bytes((path.parent / "a.png").read_bytes()[:70])
    pictures = stream_from_disk(read_manifest(path), size=(32, 32), masked=False)
    assert [float(at(pictures, index)["area_cm2"]) for index in range(3)] == [12.5, 3.0, 3.0]


def test_pictures_of_nothing_are_an_error(write: Write) -> None:
    photos = read_manifest(write("image,area_cm2\na.png,12.5\n"))
    with pytest.raises(InputError, match=r"none of the 1 photos.*no mask"):
        load_into_memory(photos, size=(32, 32), masked=True)
    with pytest.raises(InputError, match=r"none of the 1 photos.*no mask"):
        at(stream_from_disk(photos, size=(32, 32), masked=True), 0)
