import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import keras
import numpy as np
import pytest
import tensorflow as tf
from disc_runs import (
    BATCH,
    disc_stream,
    fit_discs,
    learning_curve,
    network_variables,
    read_history,
    tiny_config,
)

from laesi_tf.common import run_files, schema
from laesi_tf.common.errors import InputError
from laesi_tf.models.saved_model import load_run
from laesi_tf.synthesis import SYNTHESIS_VERSION
from laesi_tf.training import config_files, loop, run_directory
from laesi_tf.training.trainer import Trainer

HERE = Path(__file__).parent
pytestmark = pytest.mark.usefixtures("tiny_backbone")


@pytest.fixture(scope="module")
def finished_run(tiny_backbone, tmp_path_factory):
    """A run that nothing interrupted."""
    out = tmp_path_factory.mktemp("runs") / "finished_run"
    return fit_discs(tiny_config(), out)


def test_a_run_directory_holds_the_run_and_its_results(finished_run):
    rows = read_history(finished_run.path)
    assert [int(row["step"]) for row in rows] == [2, 4, 6, 8, 10, 12]
    best = min(rows, key=lambda row: float(row["val_mre"]))
    metrics = json.loads((finished_run.path / run_files.METRICS_FILE).read_text())
    assert metrics == finished_run.metrics
    assert metrics["best_step"] == int(best["step"])
    assert metrics["mre"] == pytest.approx(float(best["val_mre"]), rel=1e-4)
    run = load_run(finished_run.path)
    assert config_files.load_config(finished_run.path / run_files.CONFIG_FILE) == finished_run.config
    assert metrics["parameters"] == run.model.count_params()
    provenance = schema.read_toml(finished_run.path / run_files.CONFIG_FILE)["provenance"]
    assert provenance["weights_origin"] == "none"
    assert provenance["packages"]["keras"] == keras.__version__
    assert provenance["synthesis_version"] == SYNTHESIS_VERSION
    assert list((finished_run.path / run_files.TENSORBOARD_FOLDER).iterdir())
    assert (finished_run.path / run_files.REPORT_FILE).stat().st_size > 10_000
    assert not [path for path in finished_run.path.iterdir() if path.name.startswith(".")]


def test_tensorboard_shows_the_history(finished_run):
    (log,) = (finished_run.path / run_files.TENSORBOARD_FOLDER).iterdir()
    found = [
        (event.step, tf.make_ndarray(value.tensor).item())
        for event in tf.compat.v1.train.summary_iterator(str(log))
        for value in event.summary.value
        if value.tag == "val_mre"
    ]
    assert found == [
        (int(row["step"]), pytest.approx(float(row["val_mre"]), rel=1e-4))
        for row in read_history(finished_run.path)
    ]


# A training that stops moving in its tenth step, so that the test can kill it there.
STUCK = """
import sys, time
from pathlib import Path
import tiny_backbone
from disc_runs import disc_stream, fit_discs, tiny_config

tiny_backbone.install()
opened = []

def stuck(start):
    opened.append(start)
    training = len(opened) == 1  # the second stream is for recalibration
    for step, batch in enumerate(disc_stream(tiny_config())(start)):
        if training and step == 9:
            time.sleep(60)
        yield batch

fit_discs(tiny_config(), Path(sys.argv[1]), train=stuck)
"""


def test_a_killed_run_continues_on_the_same_curve(finished_run, tmp_path, capsys):
    out = tmp_path / "killed"
    paths = os.pathsep.join([str(HERE), str(HERE.parent)])
    child = subprocess.Popen([sys.executable, "-c", STUCK, str(out)], env=os.environ | {"PYTHONPATH": paths})
    try:
        while not (out / run_files.HISTORY_FILE).is_file() or read_history(out)[-1]["step"] != "8":
            assert child.poll() is None, "the run ended before it could be killed"
            time.sleep(0.05)
        time.sleep(0.2)  # the last checkpoint is of step 5, two validations behind
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    before = read_history(out)
    asked = []

    def watched(start):
        asked.append(start)
        return disc_stream(tiny_config())(start)

    fit_discs(tiny_config(), out, train=watched, show_progress=True)
    assert "continuing from step 5 of 12" in capsys.readouterr().err
    assert 5 * BATCH in asked
    assert read_history(out)[:2] == before[:2]
    assert learning_curve(out) == learning_curve(finished_run.path)
    for one, other in zip(network_variables(out), network_variables(finished_run.path), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_finished_run_says_so_before_anything_is_built(finished_run, monkeypatch, capsys):
    def refuse(*_, **__):
        raise AssertionError("built for nothing")

    monkeypatch.setattr(loop, "make_trainer", refuse)
    monkeypatch.setattr(loop, "InputPipeline", refuse)
    again = loop.fit(finished_run.config, finished_run.path)
    assert again.metrics == finished_run.metrics
    assert f"{finished_run.path} is finished" in capsys.readouterr().err


def test_a_longer_run_continues_where_the_learning_rate_is_constant(tmp_path):
    short, long = (tiny_config(schedule="constant", steps=steps, validate_every=4) for steps in (4, 8))
    fit_discs(short, tmp_path / "run")
    assert fit_discs(long, tmp_path / "run").metrics["steps"] == 8
    fit_discs(long, tmp_path / "at_once")
    assert learning_curve(tmp_path / "run") == learning_curve(tmp_path / "at_once")
    with pytest.raises(InputError, match="differs in steps"):
        fit_discs(short, tmp_path / "run")


def test_a_longer_run_is_refused_where_the_schedule_ends(finished_run):
    with pytest.raises(InputError, match=r"12 steps, with which its cosine learning rate ends; .* --weights"):
        fit_discs(tiny_config(steps=13), finished_run.path)


@pytest.mark.parametrize("steps_before_save", [3, 9])
def test_a_full_disk_is_one_line_and_the_run_continues(
    tmp_path, monkeypatch, steps_before_save, finished_run
):
    config, save, saves = tiny_config(checkpoint_every=3), np.savez, []

    def savez_on_full_disk(*arguments, **values):
        saves.append(None)
        if len(saves) * 3 > steps_before_save:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        save(*arguments, **values)

    monkeypatch.setattr(np, "savez", savez_on_full_disk)
    with pytest.raises(
        InputError, match=r"cannot write .*state.npz: No space left on device; free some space"
    ):
        fit_discs(config, tmp_path / "run")
    assert not [path for path in (tmp_path / "run").iterdir() if path.name.startswith(".")]
    monkeypatch.undo()
    fit_discs(config, tmp_path / "run")
    assert learning_curve(tmp_path / "run") == learning_curve(finished_run.path)


def test_another_configuration_is_refused_by_name(finished_run):
    with pytest.raises(InputError, match=r"differs in steps, seed"):
        fit_discs(tiny_config(steps=13, seed=1), finished_run.path)


def test_folders_that_are_not_run_directories_are_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="neither empty nor a run directory"):
        fit_discs(tiny_config(), tmp_path)
    with pytest.raises(InputError, match="is a file"):
        fit_discs(tiny_config(), tmp_path / "mine.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(("ctrl_c_twice", "stopped_at"), [(True, 5), (False, 6)])
def test_an_interrupted_run_reports_and_continues(finished_run, tmp_path, ctrl_c_twice, stopped_at):
    opened = []

    def interrupted(start):
        opened.append(start)
        training = len(opened) == 1  # the second stream is for recalibration
        for step, batch in enumerate(disc_stream(tiny_config())(start)):
            if training and step == 5:
                os.kill(os.getpid(), signal.SIGINT)
                if ctrl_c_twice:
                    os.kill(os.getpid(), signal.SIGINT)
            yield batch

    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt, match=f"stopped at step {stopped_at}, saved; the same command"):
        fit_discs(tiny_config(), out, train=interrupted)
    assert (out / run_files.REPORT_FILE).is_file()
    assert not (out / run_files.METRICS_FILE).exists()
    fit_discs(tiny_config(), out)
    assert learning_curve(out) == learning_curve(finished_run.path)


@pytest.mark.parametrize("at", [2, 6], ids=["in the first validation", "in the last"])
def test_an_interrupted_validation_is_repeated(tmp_path, monkeypatch, at):
    config, out, calls = tiny_config(steps=6, validate_every=2, checkpoint_every=1), tmp_path / "run", []
    evaluate = Trainer.evaluate

    def interrupted(trainer, batches):
        calls.append(None)
        if len(calls) == at // 2:
            raise KeyboardInterrupt
        return evaluate(trainer, batches)

    monkeypatch.setattr(Trainer, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt, match=f"stopped at step {at}, saved up to step {at - 1};"):
        fit_discs(config, out)
    monkeypatch.undo()
    fit_discs(config, out)
    assert [int(row["step"]) for row in read_history(out)] == [2, 4, 6]


def test_ranges_of_a_file_are_kept_and_compared(tmp_path):
    ranges, out = tmp_path / "mine.toml", tmp_path / "run"
    ranges.write_text("# wide\n")
    config = tiny_config(ranges=str(ranges))
    run_directory.create_run_directory(out, config, "none")
    assert (out / "ranges.toml").read_text() == "# wide\n"
    assert run_directory.check_run_directory(out, config) == "none"
    ranges.write_text("# narrow\n")
    with pytest.raises(InputError, match="ranges"):
        run_directory.check_run_directory(out, config)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda out: (out / run_files.CONFIG_FILE).unlink(), "no run in"),
        (lambda out: (out / run_files.BEST_MODEL_FILE).unlink(), "no best.keras yet"),
        (lambda out: (out / run_files.BEST_MODEL_FILE).write_bytes(b"PK"), "broken"),
        (
            lambda out: (out / run_files.BEST_MODEL_FILE).write_bytes(
                (out / run_files.BEST_MODEL_FILE).read_bytes()[:5000]
            ),
            "broken",
        ),
        (lambda out: (out / run_files.CONFIG_FILE).write_text("task = 'x'"), "key 'backbone' is missing"),
    ],
)
def test_runs_that_cannot_be_loaded_are_refused(tmp_path, finished_run, damage, message):
    for name in (run_files.CONFIG_FILE, run_files.BEST_MODEL_FILE):
        (tmp_path / name).write_bytes((finished_run.path / name).read_bytes())
    load_run(tmp_path)
    damage(tmp_path)
    with pytest.raises(InputError, match=message):
        load_run(tmp_path)


def test_a_broken_state_is_named(tmp_path, finished_run):
    (tmp_path / run_files.CONFIG_FILE).write_bytes((finished_run.path / run_files.CONFIG_FILE).read_bytes())
    (tmp_path / run_files.STATE_FILE).write_bytes(
        (finished_run.path / run_files.STATE_FILE).read_bytes()[:1000]
    )
    with pytest.raises(InputError, match=r"state\.npz is broken"):
        fit_discs(finished_run.config, tmp_path)
