import json
import subprocess
import sys
from pathlib import Path

import pytest

from laesi_tf import train
from laesi_tf.common import run_files
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import CONFIG_FILE
from laesi_tf.training.config_files import load_config

TINY = [
    "--size=48",
    "--alpha=0.35",
    "--batch-size=4",
    "--weights=none",
    "--validation-pictures=8",
    "--steps=3",
]


@pytest.mark.parametrize("task", ["area", "mask"])
def test_it_trains_on_live_scenes(tmp_path, capsys, task):
    (tmp_path / "c.toml").write_text(f'task = "{task}"\nsteps = 99\nseed = 4\n')
    figures = tmp_path / "figures.json"
    out = tmp_path / "run"
    train.main([f"--config={tmp_path / 'c.toml'}", f"--out={out}", f"--json={figures}", *TINY])
    told = json.loads(figures.read_text())
    assert told == json.loads((out / run_files.METRICS_FILE).read_text())
    assert told["n"] == 8
    assert told["steps"] == 3
    config = load_config(out / CONFIG_FILE)
    assert (config.task, config.steps, config.seed, config.size) == (task, 3, 4, (48, 48))
    summary = capsys.readouterr().out
    assert str(out / run_files.REPORT_FILE) in summary
    assert f"{told['mre']:.2f} %" in summary if task == "area" else f"{told['miou']:.4f}" in summary


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        (["--backbone=smal"], "did you mean 'small'"),
        (["--size=8"], "size"),
        (["--steps=ten"], "invalid int value"),
        (["--bakbone=small"], "unrecognized arguments"),
        (["--config=absent.toml"], "cannot read configuration absent.toml"),
        (["--ranges=rendering_9"], "unknown ranges"),
        (["--json=/proc/none/figures.json"], "cannot write /proc/none/figures.json"),
        (["--out=/proc/none/run"], "cannot write"),
    ],
)
def test_a_mistake_is_told_before_anything_is_written(tmp_path, monkeypatch, flags, told):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=told):
        train.main([*TINY, *flags])
    assert not list(tmp_path.iterdir())


def test_from_a_shell_a_mistake_is_one_line_and_status_2(tmp_path):
    command = [sys.executable, "-m", "laesi_tf.train", "--task=aria", "--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parent.parent)
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if line]
    assert lines == ["error: unknown task 'aria', did you mean 'area'?; choose area or mask"]
    assert not (tmp_path / "run").exists()
