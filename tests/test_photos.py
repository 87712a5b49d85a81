"""Manifests: what they say, what they may not say, and the training source made of their photos."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from green import disk, photo
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from laesi_tf.data.decoding import upright_size
from laesi_tf.data.photos import read_manifest
from laesi_tf.data.real import photos_dataset
from laesi_tf.errors import InputError

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


BAD = {
    "empty": ("", "no single column 'image'"),
    "no column": ("image,area\na.png,1\n", "no single column 'area_cm2'"),
    "column twice": ("image,area_cm2,image\na.png,1,b.png\n", "no single column 'image'"),
    "no row": ("image,area_cm2\n", "lists no photo"),
    "missing file": ("image,area_cm2\na.png,1\nc.png,1\n", "line 3: image 'c.png' does not exist"),
    "missing mask": (
        "image,area_cm2,mask\na.png,1,masks/c.png\n",
        "line 2: mask 'masks/c.png' does not exist",
    ),
    "no image": ("image,area_cm2\n,1\n", "line 2: image is not a path"),
    "folder": ("image,area_cm2\nmasks,1\n", "line 2: image 'masks' does not exist"),
    "zero area": ("image,area_cm2\na.png,0\n", "line 2: area_cm2 is '0'"),
    "negative area": ("image,area_cm2\na.png,-3\n", "line 2: area_cm2 is '-3'"),
    "nan area": ("image,area_cm2\na.png,nan\n", "line 2: area_cm2 is 'nan'"),
    "infinite area": ("image,area_cm2\na.png,inf\n", "line 2: area_cm2 is 'inf'"),
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


def test_dataset_has_every_photo_in_order(write: Write) -> None:
    photos = read_manifest(write("image,area_cm2\na.png,12.5\nb.png,3\n"))
    dataset, skipped = photos_dataset(photos, size=(32, 32))
    images, targets = zip(*dataset.as_numpy_iterator(), strict=True)
    assert skipped == [] and [target[0] for target in targets] == [12.5, 3.0]
    assert np.isnan([target[1:] for target in targets]).all()
    assert all(image.shape == (32, 32, 3) and image.dtype == np.uint8 for image in images)


def test_dataset_of_masks_covers_the_leaf(write: Write) -> None:
    photos = read_manifest(write("image,area_cm2,mask\nb.png,3,masks/b.png\n"))
    dataset, _ = photos_dataset(photos, size=(32, 32), task="mask")
    ((image, mask),) = dataset.as_numpy_iterator()
    green = image[..., 1].astype(int) - image[..., 0] > 60
    assert mask.dtype == np.uint8 and (green != mask.astype(bool)).mean() < 0.02


def test_dataset_names_what_it_skips(write: Write) -> None:
    path = write("image,area_cm2\na.png,12.5\ncut.png,5\nb.png,3\n")
    (path.parent / "cut.png").write_bytes((path.parent / "a.png").read_bytes()[:70])
    dataset, skipped = photos_dataset(read_manifest(path), size=(32, 32))
    assert [one.name for one in skipped] == ["cut.png"] and "cannot be decoded" in skipped[0].reason
    assert [float(target[0]) for _, target in dataset] == [12.5, 3.0]


def test_dataset_knows_the_factors_of_the_area(write: Write) -> None:
    photos = read_manifest(write("image,area_cm2,mask,px_per_mm\nb.png,3,masks/b.png,4\n"))
    dataset, _ = photos_dataset(photos, size=(32, 32))
    ((image, (_, scale, share)),) = dataset.as_numpy_iterator()
    green = image[..., 1].astype(int) - image[..., 0] > 60
    longest = max(upright_size(photos[0].image))
    assert scale == pytest.approx(4 * 32 / longest) and share == pytest.approx(green.mean(), abs=0.02)


def test_dataset_of_nothing_is_an_error(write: Write) -> None:
    photos = read_manifest(write("image,area_cm2\na.png,12.5\n"))
    with pytest.raises(InputError, match=r"none of the 1 photos.*no mask"):
        photos_dataset(photos, size=(32, 32), task="mask")
