import argparse
import dataclasses

import pytest

from laesi_tf.common import schema
from laesi_tf.common.errors import InputError
from laesi_tf.training import config, config_files
from laesi_tf.training.config import TrainConfig

CHANGED = {
    "task": "mask",
    "backbone": "large_minimalistic",
    "alpha": 0.75,
    "size": (96, 64),
    "weights": "some/file.weights.h5",
    "batch_size": 12,
    "steps": 11,
    "optimizer": "adamw",
    "schedule": "cosine",
    "learning_rate": 0.25,
    "final_learning_rate": 1e-5,
    "transform": "sqrt",
    "loss": "bce",
    "batch_norm": "frozen",
    "ranges": "rendering_1",
    "textures": "leaves",
    "mixture": "mixture.toml",
    "augment": "flip,hue",
    "lighting_passes": 4,
    "seed": 3,
    "validate_every": 5,
    "validation_pictures": 13,
    "checkpoint_every": 17,
    "patience": 2,
}


def test_every_field_survives_the_file(tmp_path):
    changed = TrainConfig(**CHANGED)
    assert config.differing_fields(changed, TrainConfig()) == list(CHANGED)
    assert set(CHANGED) == {field.name for field in dataclasses.fields(TrainConfig)}
    config_files.save_config(tmp_path / "config.toml", changed, {"weights_origin": "none"})
    assert config_files.load_config(tmp_path / "config.toml") == changed
    assert schema.read_toml(tmp_path / "config.toml")["provenance"] == {"weights_origin": "none"}


def test_every_field_has_a_flag_that_wins_over_the_file(tmp_path):
    parser = argparse.ArgumentParser()
    config_files.add_config_arguments(parser)
    assert vars(parser.parse_args([])) == {}
    flags = [
        f"--{name.replace('_', '-')}={'96x64' if name == 'size' else value}"
        for name, value in CHANGED.items()
    ]
    given = vars(parser.parse_args(flags))
    assert config_files.config_from_dict(given) == TrainConfig(**CHANGED)
    config_files.save_config(tmp_path / "config.toml", TrainConfig(steps=1, seed=5), {})
    assert config_files.load_config(
        tmp_path / "config.toml", **vars(parser.parse_args(["--steps=2"]))
    ) == TrainConfig(steps=2, seed=5)
    assert " ".join(parser.format_help().split()).count("(default: ") == len(CHANGED)


@pytest.mark.parametrize("size", [128, "128", "128x128", [128, 128]])
def test_size_is_a_side_or_two(size):
    assert TrainConfig(size=size).size == (128, 128)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"bakbone": "small"}, r"'bakbone', did you mean 'backbone'\?"),
        ({"backbone": "smal"}, r"'smal', did you mean 'small'\?; choose small, large or large_minimalistic"),
        ({"steps": "many"}, "steps must be a whole number, not 'many'"),
        ({"steps": 2.5}, "steps must be a whole number"),
        ({"steps": True}, "steps must be a whole number"),
        ({"alpha": "wide"}, "alpha must be a number"),
        ({"task": 3}, "task must be text"),
        ({"steps": 0}, "steps 0 is not between 1"),
        ({"learning_rate": -1.0}, "learning_rate -1.0 is not between"),
        ({"learning_rate": float("nan")}, "learning_rate nan is not between"),
        ({"size": 31}, r"size \(31, 31\) is not between 32"),
        ({"size": [64, 64, 3]}, "size must be a side"),
        ({"size": 64.0}, "size must be a side"),
        ({"loss": "bce"}, "'bce' is not for task 'area': choose huber, l1 or mse"),
        ({"task": "mask", "loss": "huber"}, "'huber' is not for task 'mask'"),
        ({"batch_size": 6, "lighting_passes": 4}, "batch_size 6 is not a multiple of lighting_passes 4"),
        ({"learning_rate": 1e-10}, "final_learning_rate 1e-09 is above learning_rate"),
    ],
)
def test_a_mistake_is_named(values, told):
    with pytest.raises(InputError, match=told):
        config_files.config_from_dict(values)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"steps = ", "not TOML"),
        (b"\xff\xfe", "not TOML"),
        (b"stepps = 3", r"c\.toml.*did you mean 'steps'"),
        (None, "cannot read"),
    ],
)
def test_a_bad_file_is_named(tmp_path, content, told):
    path = tmp_path / "c.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=told):
        config_files.load_config(path)
