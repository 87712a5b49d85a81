"""What all commands share: where their outputs go, and what --help offers."""

import argparse
import importlib
from pathlib import Path

import pytest

from laesi_tf import benchmark

ROOT = Path(__file__).parents[1]
WITH_FOLDERS = (
    *("laesi_tf.evaluate", "laesi_tf.predict", "laesi_tf.preview", "laesi_tf.similarity"),
    *("laesi_tf.stress", "laesi_tf.ablate"),
    "experiments.run",
)


@pytest.mark.parametrize("command", WITH_FOLDERS)
def test_default_output_folders_are_in_gitignore(command: str) -> None:
    parser: argparse.ArgumentParser = importlib.import_module(command)._make_parser()
    ignored = (ROOT / ".gitignore").read_text().splitlines()
    folders = {action.default for action in parser._actions if isinstance(action.default, Path)}
    assert folders
    for folder in folders:
        assert f"/{folder.parts[0]}/" in ignored


def test_help_of_benchmark_leaves_json_to_each_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--help"], *([name, "--help"] for name in benchmark.BENCHMARKS)):
        with pytest.raises(SystemExit):
            benchmark.main(arguments)
        listed = [line.split()[0] for line in capsys.readouterr().out.splitlines() if line.strip()]
        assert ("--json" in listed) == (len(arguments) == 2)
