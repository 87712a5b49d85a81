"""What the README and the guide promise about the sample photo is true."""

import contextlib
import csv
import io
import re
from pathlib import Path

import pytest

from laesi_tf import predict

ROOT = Path(__file__).parent.parent
PAGES = ("README.md", "docs/guide/measure.md")


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return the lines that `laesi predict docs/sample/leaf.jpg` prints."""
    out = tmp_path_factory.mktemp("predictions")
    text = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(text):
        patch.chdir(ROOT)
        predict.main(["docs/sample/leaf.jpg", "--out", str(out)])
    return text.getvalue().replace(str(out), "predictions").splitlines()


def numbers(line: str) -> list[float]:
    """Return the numbers with a decimal point in `line`."""
    return [float(number) for number in re.findall(r"\d+\.\d+", line)]


@pytest.mark.parametrize("page", PAGES)
def test_page_shows_what_predict_prints_for_the_sample(page: str, printed: list[str]) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    block = re.search(r"\$ laesi predict docs/sample/leaf.jpg\n(.*?)```", text, re.DOTALL)
    assert block is not None
    shown = block[1].splitlines()
    assert len(shown) == len(printed)
    for expected, actual in zip(shown, printed, strict=True):
        # Processors round differently: the last digit may change.
        assert re.sub(r"\d+\.\d+", "#", actual) == re.sub(r"\d+\.\d+", "#", expected)
        assert numbers(actual) == pytest.approx(numbers(expected), abs=0.021)


@pytest.mark.parametrize("page", PAGES)
def test_page_states_the_true_area(page: str) -> None:
    with (ROOT / "docs/sample/manifest.csv").open(encoding="utf-8") as file:
        true_cm2 = float(next(csv.DictReader(file))["area_cm2"])
    assert f"{true_cm2:.2f} cm²" in (ROOT / page).read_text(encoding="utf-8")


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150
