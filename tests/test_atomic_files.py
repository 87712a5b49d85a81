"""Tables that spreadsheets open: formulas are escaped, numbers are not."""

import csv
from pathlib import Path

import pytest

from laesi_tf.common.atomic_files import write_csv


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ("-3.5", "-3.5"),
        ("+1e-3", "+1e-3"),
        (-3.5, "-3.5"),
        (None, ""),
        ("=1+1", "'=1+1"),
        ("-2+cmd", "'-2+cmd"),
        ("@leaf.jpg", "'@leaf.jpg"),
        ("leaf.jpg", "leaf.jpg"),
    ],
)
def test_formulas_get_an_apostrophe_and_negative_numbers_do_not(
    tmp_path: Path, cell: object, written: str
) -> None:
    write_csv(tmp_path / "table.csv", ["cell", "other"], [[cell, 1]])
    with (tmp_path / "table.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [["cell", "other"], [written, "1"]]
