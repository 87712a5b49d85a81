"""Measuring with the shipped networks where only what measuring needs is installed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from laesi_tf.common.run_files import CONFIG_FILE

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "docs/sample/leaf.jpg"
SAMPLE_CM2 = 12.74

# Runs a module as `python -m` does, and lets imports of what `train` adds fail as if it were not installed.
WITHOUT = """
import runpy, sys

class NotInstalled:
    names = "tensorflow", "keras", "matplotlib", "tomli_w", "scipy"

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in self.names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, NotInstalled())
module = sys.argv.pop(1)
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def run_without(module: str, *arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", WITHOUT, f"laesi_tf.{module}", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )


def test_the_sample_is_measured(tmp_path: Path) -> None:
    figures = tmp_path / "areas.json"
    done = run_without("predict", SAMPLE, "--json", figures, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    # No line of LiteRT; on a slow machine, a progress bar.
    assert "INFO" not in done.stderr and "WARNING" not in done.stderr
    (leaf,) = json.loads(figures.read_text(encoding="utf-8"))
    assert leaf["area_cm2"] == pytest.approx(SAMPLE_CM2, abs=0.005)
    assert (tmp_path / "predictions" / "leaf.overlay.jpg").stat().st_size > 10_000


@pytest.mark.parametrize("options", [("--guess",), ("--px-per-mm", 8), ("--model", "rule_based")], ids=str)
def test_other_ways_to_measure(tmp_path: Path, options: tuple[object, ...]) -> None:
    done = run_without("predict", SAMPLE, *options, "--no-overlay", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_photos_of_known_area_are_evaluated(tmp_path: Path) -> None:
    done = run_without("evaluate", "--photos", SAMPLE.with_name("manifest.csv"), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "ruling x silhouette" in done.stdout


@pytest.mark.parametrize("option", ["--model", "--mask-model", "--ruling-model"])
def test_a_training_run_is_refused_in_one_line(tmp_path: Path, option: str) -> None:
    run = tmp_path / "run"
    run.mkdir()
    (run / CONFIG_FILE).write_text('task = "mask"\n', encoding="utf-8")
    done = run_without("predict", SAMPLE, option, run, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert str(run) in line and "pip install 'laesi_tf[train]'" in line


COMMANDS = {
    "train": ("--out", "run"),
    "generate": ("--out", "data", "--count", 4),
    "preview": (),
    "serve": ("--trust-network",),
    "export": ("--out", "phone"),
    "similarity": (ROOT / "docs", ROOT / "docs"),
    "benchmark": ("synthesis",),
    "stress": (),
    "sheet": ("--out", "sheet.pdf"),
    "web": ("--out", "page"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_that_need_tensorflow_say_so(tmp_path: Path, command: str) -> None:
    done = run_without(command, *COMMANDS[command], cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ") and line.endswith("run pip install 'laesi_tf[train]'")
    assert list(tmp_path.iterdir()) == []
