import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import discs
import keras
import numpy as np
import pytest
import tensorflow as tf

from laesi_tf.common import run_files, schema
from laesi_tf.common.errors import InputError
from laesi_tf.models.backbone import build_backbone
from laesi_tf.models.saved_model import load_run
from laesi_tf.training import config_files, loop, run_directory
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.initialisation import initialise_network
from laesi_tf.training.trainer import Trainer, TrainingDiverged

SIZE, BATCH = 32, 8
HERE = Path(__file__).parent


def make(**changes):
    options = {"alpha": 0.35, "size": SIZE, "batch_size": BATCH, "steps": 12, "weights": "none"}
    return TrainConfig(**options | {"validate_every": 2, "checkpoint_every": 5} | changes)


def stream(config, **options):
    return lambda start: discs.stream(
        task=config.task, batch_size=config.batch_size, size=config.size[0], start=start, **options
    )


def fit(config, out, **options):
    validation = stream(config, count=24)(10**6)
    return loop.fit(
        config, out, **{"train": stream(config), "validation": validation, "show_progress": False} | options
    )


def history(out):
    with (out / run_files.HISTORY_FILE).open() as file:
        return list(csv.DictReader(file))


def curve(out):
    """The history without what the clock decides."""
    clock = ("minutes", "images_per_s")
    return [{key: value for key, value in row.items() if key not in clock} for row in history(out)]


def variables(out):
    return [variable.numpy() for variable in load_run(out).model.variables]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that nothing interrupted."""
    out = tmp_path_factory.mktemp("runs") / "whole"
    return fit(make(), out)


def test_a_run_folder_holds_what_the_run_was_and_found(whole):
    rows = history(whole.path)
    assert [int(row["step"]) for row in rows] == [2, 4, 6, 8, 10, 12]
    best = min(rows, key=lambda row: float(row["val_mre"]))
    told = json.loads((whole.path / run_files.METRICS_FILE).read_text())
    assert told == whole.metrics
    assert told["best_step"] == int(best["step"])
    assert told["mre"] == pytest.approx(float(best["val_mre"]), rel=1e-4)
    run = load_run(whole.path)
    assert config_files.load_config(whole.path / run_files.CONFIG_FILE) == whole.config
    assert told["parameters"] == run.model.count_params()
    provenance = schema.read_toml(whole.path / run_files.CONFIG_FILE)["provenance"]
    assert provenance["weights_origin"] == "none"
    assert provenance["packages"]["keras"] == keras.__version__
    assert list((whole.path / run_files.TENSORBOARD_FOLDER).iterdir())
    assert (whole.path / run_files.REPORT_FILE).stat().st_size > 10_000
    assert not [path for path in whole.path.iterdir() if path.name.startswith(".")]


def test_tensorboard_shows_the_history(whole):
    (log,) = (whole.path / run_files.TENSORBOARD_FOLDER).iterdir()
    found = [
        (event.step, tf.make_ndarray(value.tensor).item())
        for event in tf.compat.v1.train.summary_iterator(str(log))
        for value in event.summary.value
        if value.tag == "val_mre"
    ]
    assert found == [
        (int(row["step"]), pytest.approx(float(row["val_mre"]), rel=1e-4)) for row in history(whole.path)
    ]


# Steps like `fit` above, but stands still in its tenth step for the test to kill it there.
STUCK = """
import sys, time
import test_training as tests

opened = []

def stuck(start):
    opened.append(start)
    training = len(opened) == 1  # the second stream is for recalibration
    for step, batch in enumerate(tests.stream(tests.make())(start)):
        if training and step == 9:
            time.sleep(60)
        yield batch

tests.fit(tests.make(), tests.Path(sys.argv[1]), train=stuck)
"""


def test_killed_and_started_again_it_draws_the_same_curve(whole, tmp_path):
    out = tmp_path / "killed"
    paths = os.pathsep.join([str(HERE), str(HERE.parent)])
    child = subprocess.Popen([sys.executable, "-c", STUCK, str(out)], env=os.environ | {"PYTHONPATH": paths})
    try:
        while not (out / run_files.HISTORY_FILE).is_file() or history(out)[-1]["step"] != "8":
            assert child.poll() is None, "the run ended before it could be killed"
            time.sleep(0.05)
        time.sleep(0.2)  # the last checkpoint is of step 5, two validations behind
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    before = history(out)
    asked = []

    def watched(start):
        asked.append(start)
        return stream(make())(start)

    fit(make(), out, train=watched)
    assert 5 * BATCH in asked
    assert history(out)[:2] == before[:2]
    assert curve(out) == curve(whole.path)
    for one, other in zip(variables(out), variables(whole.path), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_finished_run_is_not_trained_again(whole):
    def refuse(_):
        raise AssertionError("trained again")

    again = fit(whole.config, whole.path, train=refuse)
    assert again.metrics == whole.metrics


def test_another_configuration_is_refused_by_name(whole):
    with pytest.raises(InputError, match=r"differs in steps, seed"):
        fit(make(steps=13, seed=1), whole.path)


def test_folders_that_are_not_runs_are_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="neither empty nor a run directory"):
        fit(make(), tmp_path)
    with pytest.raises(InputError, match="is a file"):
        fit(make(), tmp_path / "mine.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_nothing_is_begun_where_weights_are_bad(tmp_path):
    with pytest.raises(InputError, match="no weights file"):
        fit(make(weights=str(tmp_path / "absent.weights.h5")), tmp_path / "run")
    with pytest.raises(InputError, match="'frozen' needs pretrained"):
        fit(make(batch_norm="frozen"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_loss_that_is_no_number_stops_at_its_step(tmp_path):
    def poisoned(start):
        for step, (images, target) in enumerate(stream(make())(start)):
            yield images, target * (np.nan if step == 3 else 1.0)

    with pytest.raises(
        TrainingDiverged, match=r"the loss is nan at step 4, learning rate .*--learning-rate"
    ):
        fit(make(), tmp_path / "run", train=poisoned)
    assert [row["step"] for row in history(tmp_path / "run")] == ["2"]
    assert not (tmp_path / "run" / run_files.METRICS_FILE).exists()
    assert all(np.isfinite(values).all() for values in variables(tmp_path / "run"))


def test_an_interrupted_run_reports_and_continues(whole, tmp_path):
    opened = []

    def interrupted(start):
        opened.append(start)
        training = len(opened) == 1  # the second stream is for recalibration
        for step, batch in enumerate(stream(make())(start)):
            if training and step == 5:
                raise KeyboardInterrupt
            yield batch

    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        fit(make(), out, train=interrupted)
    assert (out / run_files.REPORT_FILE).is_file()
    assert not (out / run_files.METRICS_FILE).exists()
    fit(make(), out)
    assert curve(out) == curve(whole.path)


@pytest.mark.parametrize("at", [2, 6], ids=["in the first validation", "in the last"])
def test_a_validation_that_was_interrupted_is_made_up_for(tmp_path, monkeypatch, at):
    config, out, calls = make(steps=6, validate_every=2, checkpoint_every=1), tmp_path / "run", []
    evaluate = Trainer.evaluate

    def interrupted(learner, batches):
        calls.append(None)
        if len(calls) == at // 2:
            raise KeyboardInterrupt
        return evaluate(learner, batches)

    monkeypatch.setattr(Trainer, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fit(config, out)
    monkeypatch.undo()
    fit(config, out)
    assert [int(row["step"]) for row in history(out)] == [2, 4, 6]


def test_a_stream_that_ends_early_is_a_fault(tmp_path):
    config = make(validate_every=100)
    with pytest.raises(ValueError, match="stream ended after 3 of 12"):
        fit(config, tmp_path / "run", train=stream(config, count=3 * BATCH))


def test_patience_stops_a_run_that_gains_nothing(tmp_path):
    still = {"learning_rate": 1e-12, "final_learning_rate": 1e-12}
    config = make(**still, patience=2, steps=40, validate_every=1)
    told = fit(config, tmp_path / "run").metrics
    assert told["steps"] < 20
    assert told["steps"] - told["best_step"] == 2 * config.validate_every


@pytest.mark.parametrize("task", ["area", "mask"])
def test_five_steps_are_judged_as_they_were_trained(tmp_path, task):
    config = make(task=task, steps=5, validate_every=5, batch_size=32, size=64)
    fit(config, tmp_path / "run")
    model = load_run(tmp_path / "run").model
    images = np.stack([discs.disc(index, 64)[0] for index in range(10**6, 10**6 + 256)])
    judged, trained = (model(images, training=mode).numpy()[..., 0] for mode in (False, True))
    # Batches of 256 are not those of 64 that the statistics are from: some difference is left.
    off = _rms(judged - trained)
    assert off < 0.5 * trained.std()
    # With the statistics that layers start from, as a momentum of 0.999 leaves them, all of it is off.
    for layer in model.layers:
        if isinstance(layer, keras.layers.BatchNormalization):
            layer.moving_mean.assign(tf.zeros_like(layer.moving_mean))
            layer.moving_variance.assign(tf.ones_like(layer.moving_variance))
    uncalibrated = _rms(model(images, training=False).numpy()[..., 0] - trained)
    assert uncalibrated > 0.9 * trained.std() and uncalibrated > 2 * off


def _rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.parametrize("task", ["area", "mask"])
def test_it_learns(tmp_path, task):
    config = make(task=task, steps=80, validate_every=80, batch_size=16, size=64)
    told = fit(config, tmp_path / "run").metrics
    if task == "area":
        areas = np.concatenate([batch for _, batch in stream(config, count=128)(0)])[:, 0]
        guess = 100 * np.mean(np.abs(np.median(areas) - areas) / areas)
        assert told["mre"] < 0.6 * guess
    else:
        assert told["miou"] > 0.8
        assert told["mpe"] < 0.2


def test_pretrained_weights_are_needed_once(tmp_path):
    weights = tmp_path / "w.weights.h5"
    build_backbone("small", size=(SIZE, SIZE), alpha=0.35, weights="none")[0].save_weights(weights)
    config = make(weights=str(weights), steps=4, checkpoint_every=2, batch_norm="frozen")
    out = tmp_path / "run"

    def interrupted(start):
        for step, batch in enumerate(stream(config)(start), start // BATCH):
            if step == 3:
                raise KeyboardInterrupt
            yield batch

    with pytest.raises(KeyboardInterrupt):
        fit(config, out, train=interrupted)
    weights.unlink()
    told = fit(config, out).metrics
    assert "w.weights.h5" in told["weights_origin"]
    assert told["steps"] == 4


def test_ranges_of_a_file_are_kept_and_compared(tmp_path):
    ranges, out = tmp_path / "mine.toml", tmp_path / "run"
    ranges.write_text("# wide\n")
    config = make(ranges=str(ranges))
    run_directory.create_run_directory(out, config, "none")
    assert (out / "ranges.toml").read_text() == "# wide\n"
    assert run_directory.check_run_directory(out, config) == "none"
    ranges.write_text("# narrow\n")
    with pytest.raises(InputError, match="ranges"):
        run_directory.check_run_directory(out, config)


def test_the_same_seed_builds_the_same_network():
    one, other, third = (initialise_network(make(seed=seed))[0] for seed in (1, 1, 2))
    kernels = [
        np.concatenate([np.ravel(v) for v in model.trainable_variables]) for model in (one, other, third)
    ]
    np.testing.assert_array_equal(kernels[0], kernels[1])
    assert np.abs(kernels[0] - kernels[2]).max() > 0.01


@pytest.mark.parametrize(
    ("broken", "told"),
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
def test_runs_that_cannot_be_loaded_say_why(tmp_path, whole, broken, told):
    for name in (run_files.CONFIG_FILE, run_files.BEST_MODEL_FILE):
        (tmp_path / name).write_bytes((whole.path / name).read_bytes())
    load_run(tmp_path)
    broken(tmp_path)
    with pytest.raises(InputError, match=told):
        load_run(tmp_path)


def test_a_broken_state_is_named(tmp_path, whole):
    (tmp_path / run_files.CONFIG_FILE).write_bytes((whole.path / run_files.CONFIG_FILE).read_bytes())
    (tmp_path / run_files.STATE_FILE).write_bytes((whole.path / run_files.STATE_FILE).read_bytes()[:1000])
    with pytest.raises(InputError, match=r"state\.npz is broken"):
        fit(whole.config, tmp_path)
