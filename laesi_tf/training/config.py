"""The configuration of a training run: one frozen dataclass with the defaults, limits and help of every key."""

import argparse
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from laesi_tf.common import parsing
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import format_choices, suggest_closest
from laesi_tf.data.augmentation import AUGMENTATIONS, parse_augmentations
from laesi_tf.models import area_network, mask_network
from laesi_tf.models.backbone import BACKBONES
from laesi_tf.training.optimizers import OPTIMIZERS
from laesi_tf.training.schedules import SCHEDULES


def _field(
    default: Any, text: str, *, choices: Sequence[str] = (), low: float = -math.inf, high: float = math.inf
) -> Any:
    described = {"help": text, "choices": tuple(choices), "low": low, "high": high}
    return dataclasses.field(default=default, metadata=described)


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Everything needed to repeat a run. Raises InputError for a value of the wrong type or out of range.

    The defaults are the paper's recipe on the backbone that two cores can train.
    """

    task: str = _field("area", "what to learn", choices=("area", "mask"))
    backbone: str = _field("small", "MobileNetV3 to start from", choices=tuple(BACKBONES))
    alpha: float = _field(1.0, "width: factor on the number of channels", low=0.1, high=4.0)
    size: tuple[int, int] = _field(
        (224, 224), "SIDE or HEIGHTxWIDTH of pictures in pixels", low=32, high=4096
    )
    weights: str = _field(
        "auto",
        "auto: ImageNet where it can be downloaded, else from scratch; imagenet; none; or the PATH of a file",
    )
    batch_size: int = _field(32, "pictures per step", low=1, high=4096)
    steps: int = _field(8000, "steps in all", low=1, high=10**9)
    optimizer: str = _field("rmsprop", "optimizer", choices=tuple(OPTIMIZERS))
    schedule: str = _field("piecewise", "how the learning rate falls", choices=tuple(SCHEDULES))
    learning_rate: float = _field(1e-3, "highest learning rate", low=1e-12, high=10.0)
    final_learning_rate: float = _field(1e-9, "last learning rate", low=1e-12, high=10.0)
    transform: str = _field("log", "what of the area is regressed", choices=area_network.TRANSFORMS)
    loss: str = _field(
        "auto",
        f"auto: {area_network.LOSSES[0]} for areas, {mask_network.LOSSES[0]} for masks",
        choices=("auto", *area_network.LOSSES, *mask_network.LOSSES),
    )
    batch_norm: str = _field(
        "recalibrated",
        "statistics recalibrated on training pictures before every validation, or frozen as pretrained",
        choices=("recalibrated", "frozen"),
    )
    ranges: str = _field("rendering_2", "scenes: a preset's name or the PATH of a TOML file of ranges")
    textures: str = _field(
        "", "folder of leaf photographs whose texture is blended into the synthetic leaves; empty: none"
    )
    mixture: str = _field(
        "",
        "PATH of a TOML file that mixes live scenes, records and photos; empty: live scenes alone",
    )
    augment: str = _field(
        "", f"augmentations, separated by commas: all, paper, or of {', '.join(AUGMENTATIONS)}; empty: none"
    )
    lighting_passes: int = _field(1, "pictures of the same leaf in different light", low=1, high=64)
    seed: int = _field(0, "seed of scenes and initial weights", low=0, high=2**31 - 1)
    validate_every: int = _field(500, "steps between validations", low=1, high=10**9)
    validation_pictures: int = _field(512, "fresh scenes to validate on, held in memory", low=1, high=10**6)
    checkpoint_every: int = _field(
        250, "steps between the states a killed run continues from", low=1, high=10**9
    )
    patience: int = _field(0, "validations without improvement before stopping; 0: never", low=0, high=10**6)

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, _check_value(field, getattr(self, field.name)))
        losses = {"area": area_network.LOSSES, "mask": mask_network.LOSSES}[self.task]
        if self.loss not in ("auto", *losses):
            raise InputError(
                f"loss {self.loss!r} is not for task {self.task!r}: choose {format_choices(losses)}"
            )
        parse_augmentations(self.augment)
        if self.batch_size % self.lighting_passes:
            raise InputError(
                f"batch_size {self.batch_size} is not a multiple of lighting_passes {self.lighting_passes}; "
                "change one of them"
            )
        if self.final_learning_rate > self.learning_rate:
            ends = f"{self.final_learning_rate:g} is above learning_rate {self.learning_rate:g}"
            raise InputError(f"final_learning_rate {ends}; lower it")


def differing_fields(one: TrainConfig, other: TrainConfig) -> list[str]:
    """Names of the fields in which two configurations differ."""
    names = [field.name for field in dataclasses.fields(TrainConfig)]
    return [name for name in names if getattr(one, name) != getattr(other, name)]


def _check_value(field: dataclasses.Field[Any], value: Any) -> Any:
    if field.name == "size":
        value = _parse_size(value)
    elif field.type is float and type(value) is int:
        value = float(value)
    elif type(value) is not field.type:
        raise InputError(f"{field.name} must be {_TYPE_NAMES[str(field.type)]}, not {value!r}")
    choices, low, high = (field.metadata[key] for key in ("choices", "low", "high"))
    if choices and value not in choices:
        raise InputError(
            f"unknown {field.name} {value!r}{suggest_closest(value, choices)}; choose {format_choices(choices)}"
        )
    numbers = value if isinstance(value, tuple) else () if isinstance(value, str) else (value,)
    if not all(low <= number <= high for number in numbers):
        raise InputError(f"{field.name} {value!r} is not between {low:g} and {high:g}")
    return value


_TYPE_NAMES = {str(str): "text", str(int): "a whole number", str(float): "a number"}


def _parse_size(value: Any) -> tuple[int, int]:
    """(height, width) from a side, "HEIGHTxWIDTH", or two numbers."""
    if isinstance(value, str):
        try:
            return parsing.image_size(value)
        except argparse.ArgumentTypeError as error:
            raise InputError(str(error)) from None
    sides = (value, value) if type(value) is int else value
    if isinstance(sides, list | tuple) and len(sides) == 2 and all(type(side) is int for side in sides):
        return sides[0], sides[1]
    raise InputError(f'size must be a side, [height, width] or "HEIGHTxWIDTH" in pixels, not {value!r}')
