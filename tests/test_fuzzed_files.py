"""Damaged and hostile files are refused by a message, whatever is in them."""

from pathlib import Path

import numpy as np
import pytest
from make_corpus import CORPUS

from laesi_tf.benchmarks.folder_speed import link_photos
from laesi_tf.benchmarks.fuzzed_files import MUTATIONS, write_fuzzed_files
from laesi_tf.benchmarks.predict_process import ResultCounter
from laesi_tf.common.errors import InputError
from laesi_tf.common.result_files import JOURNAL_FILE
from laesi_tf.data import decoding
from laesi_tf.data.decoding import decode_photo
from laesi_tf.data.file_resolution import read_dpi
from laesi_tf.data.photo_pages import list_pages
from laesi_tf.measuring.journal import Journal, JournalEntry
from laesi_tf.reporting.leaf_records import LeafRecord

SOURCES = ["progressive.jpg", "png.png", "two_pages.tif", "phone.heic", "webp.webp", "gif.gif", "avif.avif"]


def test_fuzzed_files_decode_or_say_why_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Bombs of 196 megapixels are within the limit, and take seconds.
    monkeypatch.setattr(decoding, "MAX_PIXELS", 1_000_000)
    sources = [CORPUS / name for name in SOURCES if (CORPUS / name).is_file()]
    assert len(sources) >= 4
    kinds = write_fuzzed_files(sources, tmp_path, count=120, seed=7)
    assert sum(kinds.values()) == 120 and set(kinds) == set(MUTATIONS) and min(kinds.values()) > 5
    for path in sorted(tmp_path.iterdir()):
        for page in list_pages(path)[:5]:
            for read in (decode_photo, read_dpi):
                try:
                    result = read(page.path, page=page.index)
                except InputError as error:
                    assert "\n" not in str(error)
                else:
                    assert isinstance(result, float) or result.dtype == np.uint8


def test_the_same_seed_makes_the_same_files(tmp_path: Path) -> None:
    for name in ("1", "2"):
        write_fuzzed_files([CORPUS / "png.png"], tmp_path / name, count=20, seed=3)
    first, second = (sorted((tmp_path / name).iterdir()) for name in ("1", "2"))
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_folders_of_links_and_counts_of_results(tmp_path: Path) -> None:
    link_photos([CORPUS / "png.png"], tmp_path / "in", count=3)
    assert sorted(path.name for path in (tmp_path / "in").iterdir()) == [
        "00000.png",
        "00001.png",
        "00002.png",
    ]
    counter = ResultCounter(tmp_path)
    assert counter.count() == 0
    journal = Journal(tmp_path / JOURNAL_FILE)
    journal.create({}, {"csv": "standard"})
    assert counter.count() == 0
    for number in (1, 2):
        record = LeafRecord(photo=f"{number}.jpg")
        journal.append(JournalEntry(key=record.photo, state=None, records=(record,)))
        assert counter.count() == number
    journal.keep_table({"csv": "excel"})
    assert counter.count() == 2
    with journal.path.open("ab") as file:
        file.write(b'{"key": "cut o')
    assert counter.count() == 2
