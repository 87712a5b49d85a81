"""What the documentation promises is true: the sample's measurement, and that its commands exist."""

import contextlib
import csv
import importlib.util
import io
import re
from pathlib import Path

import pytest

from laesi_tf import predict

ROOT = Path(__file__).parent.parent
PAGES = ("README.md", "docs/guide/measure.md")
CALL = re.compile(r"(?:\blaesi |python -m (laesi_tf|experiments|sweeps)\.)(benchmark \w+|\w+)(.*)")
"""A command as the documentation writes it: package, command, arguments."""


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


def documented_commands() -> dict[str, set[str]]:
    """Return the flags that the documentation gives to each module that it calls, by the module's name."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "laesi_tf/pretrained/MODEL_CARD.md"]
    flags: dict[str, set[str]] = {}
    for page in pages:
        if "_build" in page.parts:
            continue
        text = page.read_text(encoding="utf-8")
        fenced = re.findall(r"```\w*\n(.*?)```", text, re.DOTALL)
        inline = re.findall(r"(?<!`)`([^`]+)`(?!`)", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
        lines = [*"\n".join(fenced).replace("\\\n", " ").splitlines(), *(" ".join(c.split()) for c in inline)]
        for line in lines:
            called = CALL.search(line.partition("#")[0])
            if called is not None:
                package, command, rest = called.groups()
                module = f"{package or 'laesi_tf'}.{command}"
                flags.setdefault(module, set()).update(re.findall(r"--[a-z-]+", rest))
    return flags


COMMANDS = documented_commands()


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_documented_flags_exist(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    module, *subcommand = command.split()
    spec = importlib.util.find_spec(module)
    assert spec is not None
    if spec.submodule_search_locations:
        module += ".__main__"
    with pytest.raises(SystemExit) as exit_status:
        importlib.import_module(module).main([*subcommand, "--help"])
    assert exit_status.value.code == 0
    known = set(re.findall(r"--[a-z-]+", capsys.readouterr().out))
    assert COMMANDS[command] - {"--help"} <= known
