"""Files of every format and oddity in tests/corpus decode to the known picture, or are refused in words."""

import csv
import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from corpus_pictures import draw
from make_corpus import CORPUS, LIST

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import decode_photo, read_upright_size
from laesi_tf.data.file_formats import PHOTO_SUFFIXES
from laesi_tf.data.photo_pages import list_pages

with LIST.open(encoding="utf-8", newline="") as file:
    ROWS = {row["file"]: row for row in csv.DictReader(file)}
SHOWN = [name for name, row in ROWS.items() if row["shows"]]
REFUSED = [name for name, row in ROWS.items() if row["refusal"]]


def test_the_list_is_complete_and_small() -> None:
    assert {path.name for path in CORPUS.iterdir()} == {*ROWS, LIST.name}
    assert len(SHOWN) + len(REFUSED) == len(ROWS)
    assert sum(path.stat().st_size for path in CORPUS.iterdir()) < 400_000


@pytest.mark.parametrize("name", ROWS)
def test_file_is_the_one_of_the_list(name: str) -> None:
    assert hashlib.sha256((CORPUS / name).read_bytes()).hexdigest() == ROWS[name]["sha256"]


@pytest.mark.parametrize("name", SHOWN)
def test_file_shows_the_picture(name: str) -> None:
    row = ROWS[name]
    expected = draw(row["shows"])
    image = decode_photo(CORPUS / name)
    assert image.dtype == np.uint8 and image.shape == expected.shape
    difference = np.abs(image.astype(int) - expected)
    assert difference.mean(axis=(0, 1)).max() <= float(row["tolerance"]), difference.mean(axis=(0, 1))
    assert read_upright_size(CORPUS / name) == expected.shape[:2]


@pytest.mark.parametrize("name", REFUSED)
def test_file_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(InputError) as raised:
        decode_photo(CORPUS / name)
    message = str(raised.value)
    assert ROWS[name]["refusal"] in message and name in message
    assert ";" in message and message.isprintable() and len(message) < 300


def test_every_file_is_found_in_a_folder() -> None:
    assert {Path(name).suffix for name in ROWS} <= PHOTO_SUFFIXES


def test_pages_are_named() -> None:
    pages = list_pages(CORPUS / "two_pages.tif")
    assert [page.name for page in pages] == ["two_pages.tif#1", "two_pages.tif#2"]
    first, second = (decode_photo(page.path, page=page.index) for page in pages)
    assert np.array_equal(first, draw("picture")) and np.array_equal(second, np.rot90(first, 2))


@pytest.mark.parametrize(
    "name",
    ["with_thumbnail.tif", "after_thumbnail.tif", "lzw.tif", "jpeg.jpg", "phone.mpo", "cut.jpg", "none.jpg"],
)
def test_files_of_one_photo_are_named_by_their_path(name: str) -> None:
    assert [str(page) for page in list_pages(CORPUS / name)] == [str(CORPUS / name)]


def cut(content: bytearray, rng: np.random.Generator) -> None:
    del content[rng.integers(1, len(content)) :]


def flip_bits(content: bytearray, rng: np.random.Generator) -> None:
    for at in rng.integers(0, min(len(content), 300), rng.integers(1, 6)):
        content[at] ^= 1 << rng.integers(8)


def write_extremes(content: bytearray, rng: np.random.Generator) -> None:
    for at in rng.integers(0, len(content), 3):
        content[at : at + 4] = rng.choice(
            [b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\0\1\0\0"]
        )


def append_another(content: bytearray, rng: np.random.Generator) -> None:
    cut(content, rng)
    content += (CORPUS / rng.choice(list(ROWS))).read_bytes()


@pytest.mark.parametrize("damage", [cut, flip_bits, write_extremes, append_another])
@pytest.mark.parametrize("seed", range(20))
def test_damaged_files_and_wrong_suffixes_raise_nothing_else(
    damage: Callable[[bytearray, np.random.Generator], None], seed: int, tmp_path: Path
) -> None:
    rng = np.random.default_rng([seed, len(damage.__name__)])
    content = bytearray((CORPUS / rng.choice([name for name in ROWS if name != "empty.jpg"])).read_bytes())
    damage(content, rng)
    path = tmp_path / f"damaged{rng.choice(sorted(PHOTO_SUFFIXES))}"
    path.write_bytes(content)
    for page in list_pages(path):
        try:
            assert decode_photo(page.path, page=page.index).dtype == np.uint8
        except InputError as error:
            assert str(path) in str(error) and str(error).isprintable()
