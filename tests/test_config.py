import argparse
import dataclasses

import pytest

from laesi_tf.common import schema
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import PRETRAINED
from laesi_tf.data.augmentation import AUGMENTATIONS
from laesi_tf.models.area_network import LOSSES as AREA_LOSSES
from laesi_tf.models.area_network import TRANSFORMS
from laesi_tf.models.backbone import BACKBONES
from laesi_tf.models.mask_network import LOSSES as MASK_LOSSES
from laesi_tf.training import config, config_files
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.optimizers import OPTIMIZERS
from laesi_tf.training.schedules import SCHEDULES
from laesi_tf.training.tasks import TASKS

EMPTY_BY_DEFAULT = ("textures", "mixture", "augment")
CHANGED = {
    "task": "mask",
    "backbone": "large_minimalistic",
    "alpha": 0.75,
    "size": (96, 64),
    "weights": "some/file.weights.h5",
    "batch_size": 12,
    "steps": 11,
    "optimizer": "adamw",
    "schedule": "linear",
    "learning_rate": 0.25,
    "final_learning_rate": 1e-5,
    "transform": "sqrt",
    "loss": "bce",
    "batch_norm": "frozen",
    "precision": "mixed_bfloat16",
    "ranges": "rendering_1",
    "textures": "leaves",
    "mixture": "mixture.toml",
    "augment": "flip,hue",
    "copy_paste": 0.25,
    "lighting_passes": 4,
    "seed": 3,
    "validate_every": 5,
    "validation_pictures": 13,
    "checkpoint_every": 17,
    "patience": 2,
}


def test_every_field_survives_the_file(tmp_path):
    changed = TrainConfig(**CHANGED)
    assert schema.list_differing_fields(changed, TrainConfig()) == list(CHANGED)
    assert set(CHANGED) == {field.name for field in dataclasses.fields(TrainConfig)}
    config_files.save_config(tmp_path / "config.toml", changed, {"weights_origin": "none"})
    assert config_files.load_config(tmp_path / "config.toml") == changed
    assert schema.read_toml(tmp_path / "config.toml")["provenance"] == {"weights_origin": "none"}


def test_every_field_has_a_flag_that_wins_over_the_file(tmp_path):
    parser = argparse.ArgumentParser()
    schema.add_option_arguments(parser, TrainConfig)
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
    shown = " ".join(parser.format_help().split())
    assert shown.count("(default: ") == len(CHANGED) - len(EMPTY_BY_DEFAULT)
    assert "(default: 224x224)" in shown and "(default: )" not in shown


@pytest.mark.parametrize("size", [128, "128", "128x128", [128, 128]])
def test_size_is_a_side_or_two(size):
    assert TrainConfig(size=size).size == (128, 128)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"bakbone": "small"}, r"unknown key 'bakbone'; did you mean 'backbone'\?"),
        (
            {"backbone": "smal"},
            r"backbone = 'smal' must be small, large or large_minimalistic; did you mean 'small'\?",
        ),
        ({"steps": "many"}, "steps = 'many' must be a whole number between 1 and 1000000000"),
        ({"steps": 2.5}, "steps = 2.5 must be a whole number"),
        ({"steps": True}, "steps = True must be a whole number"),
        ({"alpha": "wide"}, "alpha = 'wide' must be a number between 0.1 and 4"),
        ({"task": 3}, "task = 3 must be area, mask or ruling"),
        ({"weights": 3}, "weights = 3 must be text"),
        ({"steps": 0}, "steps = 0 must be a whole number between 1"),
        ({"learning_rate": -1.0}, "learning_rate = -1.0 must be a number between"),
        ({"learning_rate": float("nan")}, "learning_rate = nan must be a number between"),
        ({"size": 31}, "size = 31 must be a number between 32 and 4096"),
        ({"size": [64, 64, 3]}, r"size = \[64, 64, 3\] must be a side"),
        ({"size": 64.0}, "size = 64.0 must be a side"),
        ({"size": 48, "task": "ruling"}, "size = 48x48 must be at least 64 pixels a side for task 'ruling'"),
        ({"augment": "flip,blur"}, "augment = 'blur' must be brightness, "),
        ({"augment": "all,flip"}, "augment = 'all' must be"),
        ({"loss": "bce"}, "loss = 'bce' must be huber, l1 or mse for task 'area'"),
        ({"task": "mask", "loss": "huber"}, "loss = 'huber' must be bce_dice or bce for task 'mask'"),
        ({"batch_size": 6, "lighting_passes": 4}, "batch_size = 6 must be a multiple of lighting_passes = 4"),
        ({"learning_rate": 1e-10}, "final_learning_rate = 1e-09 must not be above learning_rate = 1e-10"),
    ],
)
def test_a_mistake_is_named(values, message):
    with pytest.raises(InputError, match=message):
        config_files.config_from_dict(values)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"steps = ", "not TOML"),
        (b"\xff\xfe", "not TOML"),
        (b"stepps = 3", r"c\.toml: unknown key 'stepps'; did you mean 'steps'\?"),
        (None, "cannot read"),
    ],
)
def test_a_bad_file_is_named(tmp_path, content, message):
    path = tmp_path / "c.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        config_files.load_config(path)


def test_the_words_of_the_configuration_are_those_of_the_registries():
    assert tuple(BACKBONES) == config.BACKBONE_NAMES
    assert tuple(OPTIMIZERS) == config.OPTIMIZER_NAMES
    assert tuple(SCHEDULES) == config.SCHEDULE_NAMES
    assert config.TRANSFORM_NAMES == TRANSFORMS
    assert tuple(AUGMENTATIONS) == config.AUGMENTATION_NAMES
    losses = {"area": AREA_LOSSES, "mask": MASK_LOSSES, "ruling": ("cross_entropy",)}
    assert {name: task.losses for name, task in TASKS.items()} == losses


def test_defaults_are_the_recipe_of_the_shipped_area_network():
    shipped = config_files.load_config(PRETRAINED / "area" / "config.toml")
    assert set(schema.list_differing_fields(shipped, TrainConfig())) <= {"weights", "checkpoint_every"}
