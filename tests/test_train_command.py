import json
import subprocess
import sys
from pathlib import Path

import pytest
from scenes import only

from laesi_tf import train
from laesi_tf.common import run_files
from laesi_tf.common.errors import InputError
from laesi_tf.training import initialisation
from laesi_tf.training.config_files import load_config
from laesi_tf.training.input_pipeline import InputPipeline

TINY = [
    "--size=48",
    "--alpha=0.35",
    "--batch-size=4",
    "--weights=none",
    "--validation-pictures=8",
    "--steps=3",
]


@pytest.mark.usefixtures("tiny_backbone")
@pytest.mark.parametrize("task", ["area", "mask"])
def test_it_trains_on_live_scenes(tmp_path, capsys, task):
    (tmp_path / "c.toml").write_text(f'task = "{task}"\nsteps = 99\nseed = 4\n')
    ranges = tmp_path / "simple.toml"
    ranges.write_text(f"without = {sorted(only('ruling').without)}\n")
    json_path = tmp_path / "metrics.json"
    out = tmp_path / "run"
    files = [f"--config={tmp_path / 'c.toml'}", f"--ranges={ranges}", f"--out={out}", f"--json={json_path}"]
    train.main([*files, *TINY])
    metrics = json.loads(json_path.read_text())
    assert metrics == json.loads((out / run_files.METRICS_FILE).read_text())
    assert metrics["n"] == 8
    assert metrics["steps"] == 3
    config = load_config(out / run_files.CONFIG_FILE)
    assert (config.task, config.steps, config.seed, config.size) == (task, 3, 4, (48, 48))
    summary = capsys.readouterr().out
    assert str(out / run_files.REPORT_FILE) in summary
    assert f"{metrics['mre']:.2f} %" in summary if task == "area" else f"{metrics['miou']:.4f}" in summary


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--backbone=smal"], "did you mean 'small'"),
        (["--size=8"], "size = 8 must be a number between 32 and 4096"),
        (["--steps=ten"], "argument --steps: 'ten' is not a whole number"),
        (["--bakbone=small"], "unrecognized arguments"),
        (["--config=absent.toml"], "cannot read configuration absent.toml"),
        (["--ranges=rendering_9"], "unknown ranges"),
        (["--ranges=absent.toml"], "absent.toml"),
        (["--mixture=absent.toml"], "cannot read mixture absent.toml"),
        (["--json=/proc/none/figures.json"], "cannot write /proc/none/figures.json: there is no folder"),
        (["--json=/nodir/x.json"], "cannot write /nodir/x.json: there is no folder /nodir"),
        (["--out=/proc/none/run"], "cannot write /proc/none/run"),
    ],
)
def test_bad_input_is_refused_before_expensive_work_and_leaves_nothing(tmp_path, monkeypatch, flags, message):
    def refuse(*_, **__):
        raise AssertionError("expensive work before a cheap check")

    monkeypatch.setattr(initialisation, "build_network", refuse)
    monkeypatch.setattr(InputPipeline, "validation_batches", refuse)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        train.main([*TINY, *flags])
    assert not list(tmp_path.iterdir())
    assert not Path("/nodir").exists()


def test_bad_input_from_a_shell_is_one_line_and_status_2(tmp_path):
    command = [sys.executable, "-X", "importtime", "-m", "laesi_tf.train", "--task=aria"]
    command += ["--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parent.parent)
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if not line.startswith("import time:")]
    assert lines == ["error: task = 'aria' must be area, mask or ruling; did you mean 'area'?"]
    assert " tensorflow" not in done.stderr
    assert not (tmp_path / "run").exists()
