"""Manifests of photos: spellings that are accepted, mistakes that are named."""

from pathlib import Path

import pytest
from green import photo
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from photo_sets import WriteManifest, make_photo_set
from PIL import Image

from laesi_tf.common.errors import InputError
from laesi_tf.data.manifest import read_manifest


@pytest.fixture
def write(tmp_path: Path) -> WriteManifest:
    return make_photo_set(tmp_path)


def test_every_column(write: WriteManifest) -> None:
    path = write(
        "species,image,area_cm2,visible_area_cm2,mask,px_per_mm,grid_mm,split,subset,note\n"
        "beech,a.png,12.5,11.25,masks/a.png,4.5,5,test,easy,whatever\noak,b.png,3,,,,,,,\n"
    )
    first, second = read_manifest(path)
    assert (first.name, first.image, first.mask) == (
        "a.png",
        path.parent / "a.png",
        path.parent / "masks/a.png",
    )
    assert (first.area_cm2, first.px_per_mm, first.grid_mm) == (12.5, 4.5, 5.0)
    assert (first.visible_area_cm2, first.seen_cm2) == (11.25, 11.25)
    assert (second.visible_area_cm2, second.seen_cm2) == (None, 3.0)
    assert (first.split, first.subset, first.species) == ("test", "easy", "beech")
    assert (second.mask, second.px_per_mm, second.grid_mm, second.split) == (None, None, None, None)


def test_split_is_chosen(write: WriteManifest) -> None:
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
def test_spellings(write: WriteManifest, content: str) -> None:
    (only,) = read_manifest(write(content))
    assert only.area_cm2 == 12.5 and only.image.samefile(only.image.parent / "a.png")


def test_missing_files_are_reported_when_they_are_decoded(write: WriteManifest) -> None:
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
    "twice": ("image,area_cm2\na.png,1\nb.png,1\n./a.png,2\n", "line 4: image './a.png' is in line 2"),
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
def test_bad_manifests(write: WriteManifest, content: str | bytes, message: str) -> None:
    path = write(content)
    (path.parent / "link.png").symlink_to(path.parent.parent / "outside.png")
    with pytest.raises(InputError, match=message) as raised:
        read_manifest(path)
    assert str(path) in str(raised.value) and ";" in str(raised.value)


def test_mask_is_compared_with_the_upright_image(write: WriteManifest) -> None:
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
def test_any_text_is_read_or_refused(write: WriteManifest, content: bytes) -> None:
    path = write(content)
    try:
        photos = read_manifest(path)
    except InputError as error:
        assert str(path) in str(error)
    else:
        assert all(one.image.resolve().is_relative_to(path.parent.resolve()) for one in photos)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(area=st.floats(1e-6, 1e6), subset=st.text(st.characters(categories=("L", "N")), max_size=20))
def test_values_survive(write: WriteManifest, area: float, subset: str) -> None:
    (only,) = read_manifest(write(f"image,area_cm2,subset\na.png,{area!r},{subset}\n"))
    assert only.area_cm2 == area and only.subset == (subset or None)
