"""Run directories are read as numbers: whatever else they hold, nothing in them runs."""

from pathlib import Path

import keras
import numpy as np
import pytest

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import BEST_MODEL_FILE, CONFIG_FILE
from laesi_tf.models.saved_model import ModelSpec, build_network, load_run
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.config_files import save_config

CONFIG = TrainConfig(task="mask", size=(32, 48), alpha=0.35, weights="none")
SPEC = ModelSpec(task="mask", backbone="small", alpha=0.35, size=(32, 48), transform="log")


def write_run(path: Path, network: keras.Model) -> Path:
    path.mkdir()
    save_config(path / CONFIG_FILE, CONFIG, {"weights_origin": "none"})
    network.save(path / BEST_MODEL_FILE)
    return path


def with_lambda_that_writes(marker: Path, network: keras.Model) -> keras.Model:
    """Append a layer whose Python code creates `marker` whenever the network is built from its file."""
    code = f"lambda x: (__import__('pathlib').Path({str(marker)!r}).touch(), x)[1]"
    return keras.Model(network.input, keras.layers.Lambda(eval(code))(network.output))


def test_weights_fill_the_network_that_the_configuration_names(tmp_path: Path) -> None:
    keras.utils.set_random_seed(5)
    original = build_network(SPEC).model
    run = load_run(write_run(tmp_path / "run", original))
    assert run.spec == SPEC
    images = np.random.default_rng(0).integers(0, 256, (2, 32, 48, 3)).astype(np.float32)
    np.testing.assert_array_equal(run.model(images, training=False), original(images, training=False))


def test_a_run_from_elsewhere_runs_no_code(tmp_path: Path) -> None:
    marker = tmp_path / "marker"
    network = with_lambda_that_writes(marker, build_network(SPEC).model)
    path = write_run(tmp_path / "run", network)
    marker.unlink(missing_ok=True)
    keras.models.load_model(path / BEST_MODEL_FILE, safe_mode=False)
    assert marker.exists()  # Keras does run what the file holds
    marker.unlink()
    load_run(path)
    assert not marker.exists()


def test_weights_of_another_network_are_refused(tmp_path: Path) -> None:
    inputs = keras.Input((32, 48, 3))
    other = keras.Model(inputs, keras.layers.Conv2D(1, 1, activation="sigmoid")(inputs))
    with pytest.raises(InputError, match=r"best\.keras is broken or does not fit the config\.toml"):
        load_run(write_run(tmp_path / "run", other))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('backbone = "smal"', "backbone = 'smal' must be small, .*; did you mean 'small'"),
        ("alpha = 99", "alpha = 99 must be a number between 0.1 and 4"),
        ('size = "64"', "is not \\[height, width\\]"),
        ("task = 3", "task = 3 must be area, mask or ruling"),
    ],
)
def test_configurations_of_no_network_are_refused(tmp_path: Path, line: str, message: str) -> None:
    values = {"task": '"area"', "backbone": '"small"', "alpha": "1.0", "size": "[64, 64]"}
    key, _, value = line.partition(" = ")
    text = "".join(f"{name} = {text}\n" for name, text in (values | {key: value}).items())
    (tmp_path / CONFIG_FILE).write_text(text + 'transform = "log"\n')
    with pytest.raises(InputError, match=rf"config\.toml: .*{message}"):
        load_run(tmp_path)
