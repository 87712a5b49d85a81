"""The configuration of a training run: defaults, limits and help of every key of its file and its flags.

Nothing here needs TensorFlow, so that `train --help` and wrong flags answer at once. A test compares the
words listed here with the registries that implement them.
"""

from dataclasses import dataclass
from typing import Any

from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import check_choice, check_fields, format_choices, option
from laesi_tf.training.tasks import TASKS

BACKBONE_NAMES = ("small", "large", "large_minimalistic")
OPTIMIZER_NAMES = ("rmsprop", "adam", "adamw", "nadam", "sgd")
SCHEDULE_NAMES = ("piecewise", "cosine", "exponential", "linear", "constant")
PRECISION_NAMES = ("float32", "mixed_float16", "mixed_bfloat16")
TRANSFORM_NAMES = ("log", "sqrt", "none")
AUGMENTATION_NAMES = (
    "brightness",
    "contrast",
    "hue",
    "saturation",
    "flip",
    "rotation90",
    "rotation",
    "gaussian",
    "poisson",
)
NONE, MIRRORED, MULTI_WORKER = STRATEGIES = ("none", "mirrored", "multi-worker")
"""What trains: one device, all devices of a machine, or those of several. No part of the configuration, as it
changes no result."""
_AUGMENTATION_SETS = ("all", "paper")


def parse_size(value: Any) -> tuple[int, int]:
    """Return (height, width) from a side, "HEIGHTxWIDTH", or two numbers. Raises ValueError."""
    if isinstance(value, str):
        parts = value.lower().split("x")
        value = [int(part) for part in parts] if all(part.isdigit() for part in parts) else None
        value = value * 2 if value and len(value) == 1 else value
    sides = (value, value) if type(value) is int else value
    if isinstance(sides, list | tuple) and len(sides) == 2 and all(type(side) is int for side in sides):
        return sides[0], sides[1]
    raise ValueError('a side, [height, width] or "HEIGHTxWIDTH" in pixels')


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Everything needed to repeat a run. Raises InputError for a value of the wrong type or out of range.

    The defaults are the recipe of the area network that comes with the package.
    """

    task: str = option("area", "what to learn", choices=TASKS)
    backbone: str = option("small", "MobileNetV3 to start from", choices=BACKBONE_NAMES)
    alpha: float = option(1.0, "width: factor on the number of channels", low=0.1, high=4.0)
    size: tuple[int, int] = option(
        (224, 224),
        "SIDE or HEIGHTxWIDTH of images in pixels",
        low=32,
        high=4096,
        parse=parse_size,
    )
    weights: str = option(
        "auto",
        "auto: ImageNet where it can be downloaded, else random; imagenet; none: random; the PATH of a file "
        "of backbone weights; or a RUN whose network is trained on",
    )
    batch_size: int = option(32, "images per step", low=1, high=4096)
    steps: int = option(8000, "number of steps", low=1, high=10**9)
    optimizer: str = option("adam", "optimizer", choices=OPTIMIZER_NAMES)
    schedule: str = option("cosine", "how the learning rate falls", choices=SCHEDULE_NAMES)
    learning_rate: float = option(1e-3, "highest learning rate", low=1e-12, high=10.0)
    final_learning_rate: float = option(1e-9, "last learning rate", low=1e-12, high=10.0)
    transform: str = option("log", "transform of the area that is regressed", choices=TRANSFORM_NAMES)
    loss: str = option(
        "auto",
        "auto: " + ", ".join(f"{task.losses[0]} for task {name}" for name, task in TASKS.items()),
        metavar="|".join(["auto", *(loss for task in TASKS.values() for loss in task.losses)]),
    )
    batch_norm: str = option(
        "recalibrated",
        "statistics recalibrated on training images before every validation, or frozen as pretrained",
        choices=("recalibrated", "frozen"),
    )
    precision: str = option(
        "float32",
        "arithmetic of the backbone: mixed_float16 or mixed_bfloat16 compute in 16 bits, for GPUs; weights, "
        "head and loss stay in 32",
        choices=PRECISION_NAMES,
    )
    ranges: str = option("rendering_2", "scenes: the name of a preset or the PATH of a TOML file of ranges")
    textures: str = option(
        "", "folder of leaf photos whose texture is blended into the synthetic leaves; empty: none"
    )
    mixture: str = option(
        "", "PATH of a TOML file that mixes live scenes, records and photos; empty: live scenes alone"
    )
    augment: str = option(
        "",
        "augmentations, separated by commas: all, paper, or any of "
        f"{', '.join(AUGMENTATION_NAMES)}; empty: none",
    )
    copy_paste: float = option(
        0.0,
        "share of training images onto which the leaf of another one is pasted; task mask",
        low=0.0,
        high=1.0,
        metavar="SHARE",
    )
    lighting_passes: int = option(1, "images of the same leaf in different light", low=1, high=64)
    seed: int = option(0, "seed of scenes and initial weights", low=0, high=2**31 - 1)
    validate_every: int = option(500, "steps between validations", low=1, high=10**9)
    validation_pictures: int = option(
        512, "fresh scenes to validate on, kept in memory", low=1, high=10**6, metavar="IMAGES"
    )
    checkpoint_every: int = option(
        250, "steps between the states that a stopped run continues from", low=1, high=10**9
    )
    patience: int = option(0, "validations without improvement before stopping; 0: never", low=0, high=10**6)

    def __post_init__(self) -> None:
        check_fields(self)
        losses = TASKS[self.task].losses
        if self.loss not in ("auto", *losses):
            raise InputError(f"loss = {self.loss!r} must be {format_choices(losses)} for task {self.task!r}")
        if min(self.size) < (least := TASKS[self.task].min_side_px):
            size = "x".join(map(str, self.size))
            raise InputError(f"size = {size} must be at least {least} pixels a side for task {self.task!r}")
        _check_augmentations(self.augment)
        if TASKS[self.task].live_scenes_only and (self.mixture or self.augment or self.lighting_passes != 1):
            raise InputError(
                f"task {self.task!r} is trained on live scenes in one light; leave out mixture, augment and "
                "lighting_passes"
            )
        if self.precision != "float32" and not TASKS[self.task].has_backbone:
            raise InputError(
                f"precision = {self.precision!r} concerns the backbone, and task {self.task!r} has none; "
                "leave it out"
            )
        if self.copy_paste and not TASKS[self.task].needs_masks:
            raise InputError(f"copy_paste needs the masks of task 'mask'; leave it out for {self.task!r}")
        if self.batch_size % self.lighting_passes:
            raise InputError(
                f"batch_size = {self.batch_size} must be a multiple of "
                f"lighting_passes = {self.lighting_passes}"
            )
        if self.final_learning_rate > self.learning_rate:
            raise InputError(
                f"final_learning_rate = {self.final_learning_rate:g} must not be above "
                f"learning_rate = {self.learning_rate:g}"
            )


def _check_augmentations(text: str) -> None:
    if text not in _AUGMENTATION_SETS:
        for name in filter(None, map(str.strip, text.split(","))):
            check_choice("augment", name, AUGMENTATION_NAMES)
