import itertools
from typing import ClassVar

import keras
import numpy as np
import pytest
import tensorflow as tf
from disc_runs import BATCH, SIZE, disc_stream, fit_discs, network_variables, read_history, tiny_config

from laesi_tf.common import run_files
from laesi_tf.common.errors import InputError
from laesi_tf.models.backbone import build_backbone
from laesi_tf.models.saved_model import HEAD_BUILDERS, load_run
from laesi_tf.training.initialisation import initialise_network
from laesi_tf.training.tasks import TASKS
from laesi_tf.training.tasks.base import Task
from laesi_tf.training.trainer import TrainingDiverged

pytestmark = pytest.mark.usefixtures("tiny_backbone")


def test_bad_weights_leave_no_run_directory(tmp_path):
    with pytest.raises(InputError, match="no weights file"):
        fit_discs(tiny_config(weights=str(tmp_path / "absent.weights.h5")), tmp_path / "run")
    with pytest.raises(InputError, match="'frozen' needs pretrained"):
        fit_discs(tiny_config(batch_norm="frozen"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_loss_that_is_not_finite_ends_the_run_at_its_step(tmp_path):
    def poisoned(start):
        for step, (images, target) in enumerate(disc_stream(tiny_config())(start)):
            yield images, target * (np.nan if step == 3 else 1.0)

    with pytest.raises(TrainingDiverged, match=r"the loss is nan at step 4, learning rate .*--learning-rate"):
        fit_discs(tiny_config(), tmp_path / "run", train=poisoned)
    assert [row["step"] for row in read_history(tmp_path / "run")] == ["2"]
    assert not (tmp_path / "run" / run_files.METRICS_FILE).exists()
    assert all(np.isfinite(values).all() for values in network_variables(tmp_path / "run"))


def test_a_stream_that_ends_early_is_an_error(tmp_path):
    config = tiny_config(validate_every=100)
    with pytest.raises(ValueError, match="stream ended after 3 of 12"):
        fit_discs(config, tmp_path / "run", train=disc_stream(config, count=3 * BATCH))


def test_patience_ends_a_run_that_does_not_improve(tmp_path):
    still = {"learning_rate": 1e-12, "final_learning_rate": 1e-12}
    config = tiny_config(**still, patience=2, steps=40, validate_every=1)
    metrics = fit_discs(config, tmp_path / "run").metrics
    assert metrics["steps"] < 20
    assert metrics["steps"] - metrics["best_step"] == 2 * config.validate_every


def test_a_continued_run_does_not_need_its_pretrained_weights(tmp_path):
    weights = tmp_path / "w.weights.h5"
    build_backbone("small", size=(SIZE, SIZE), alpha=0.35, weights="none")[0].save_weights(weights)
    config = tiny_config(weights=str(weights), steps=4, checkpoint_every=2, batch_norm="frozen")
    out = tmp_path / "run"

    def interrupted(start):
        for step, batch in enumerate(disc_stream(config)(start), start // BATCH):
            if step == 3:
                raise KeyboardInterrupt
            yield batch

    with pytest.raises(KeyboardInterrupt):
        fit_discs(config, out, train=interrupted)
    weights.unlink()
    metrics = fit_discs(config, out).metrics
    assert "w.weights.h5" in metrics["weights_origin"]
    assert metrics["steps"] == 4


def test_the_same_seed_builds_the_same_network():
    one, other, third = (initialise_network(tiny_config(seed=seed))[0] for seed in (1, 1, 2))
    kernels = [
        np.concatenate([np.ravel(v) for v in model.trainable_variables]) for model in (one, other, third)
    ]
    np.testing.assert_array_equal(kernels[0], kernels[1])
    assert np.abs(kernels[0] - kernels[2]).max() > 0.01


def test_the_network_of_a_run_can_be_trained_on(tmp_path):
    first = fit_discs(tiny_config(steps=2), tmp_path / "first")
    weights = {"weights": str(first.path)}
    network, origin = initialise_network(tiny_config(steps=2, seed=1, **weights))
    for value, variable in zip(network_variables(first.path), network.variables, strict=True):
        np.testing.assert_array_equal(value, variable.numpy())
    assert origin.startswith("run first, sha256 ")
    fit_discs(tiny_config(steps=2, batch_norm="frozen", **weights), tmp_path / "second")
    with pytest.raises(
        InputError, match=r"is a run with task = 'area'; it cannot start one with task = 'mask'"
    ):
        initialise_network(tiny_config(task="mask", **weights))


class BrightnessTask(Task):
    """A third task: regress the mean brightness of the image, 0..1."""

    name = "brightness"
    title = "Brightness"
    losses = ("mae",)
    main_metric = "mae"
    higher_is_better = False
    metric_labels: ClassVar = {"mae": "mean absolute error"}

    def make_target(self, sample):
        return tf.reduce_mean(tf.cast(sample["image"], tf.float32))[tf.newaxis] / 255.0

    def loss(self, output, target):
        return tf.reduce_mean(tf.abs(output - target))

    def sample_metrics(self, output, target):
        return {"error": np.abs(output - target)[:, 0]}

    def aggregate(self, arrays):
        return {"mae": float(np.mean(arrays["error"]))}

    def headline(self, metrics, validation_name):
        return f"Off by {metrics['mae']:.3f} on {validation_name}."

    def summary(self, metrics):
        return f"MAE {metrics['mae']:.3f}"

    def caption(self, arrays):
        return f"off by {arrays['error']:.3f}"


def test_a_third_task_is_one_class_and_its_network(tmp_path, monkeypatch):
    def add_head(base, spec):
        pooled = keras.layers.GlobalAveragePooling2D()(base.output)
        return keras.Model(base.input, keras.layers.Dense(1)(pooled))

    monkeypatch.setitem(TASKS, "brightness", BrightnessTask)
    monkeypatch.setitem(HEAD_BUILDERS, "brightness", add_head)
    config = tiny_config(task="brightness", loss="mae", steps=2)
    task = BrightnessTask(config)

    def batches(start):
        for images, _ in disc_stream(tiny_config())(start):
            yield images, tf.stack([task.make_target({"image": image}) for image in images])

    validation = list(itertools.islice(batches(10**6), 2))
    metrics = fit_discs(config, tmp_path / "run", train=batches, validation=validation).metrics
    assert metrics["task"] == "brightness" and 0 <= metrics["mae"] < 10
    assert load_run(tmp_path / "run").spec.task == "brightness"
    page = (tmp_path / "run" / "report.html").read_text()
    assert "<h1>Brightness, run run</h1>" in page and "Off by" in page and "mean absolute error" in page
