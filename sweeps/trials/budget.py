"""Resources of a trial: scenes, image size, images, steps, initial weights; and their options."""

import argparse
import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import add_option_arguments, check_fields, format_default, option
from laesi_tf.training.config import TrainConfig
from sweeps.trials.search_space import LEARNING_RATES, Point

EVALUATION_BATCH = 64
"""Validation images that a network gets at once; every other batch size would be traced anew."""
_IMAGENET, _FROM_SCRATCH = "imagenet", "none"


@dataclass(frozen=True, kw_only=True)
class Budget:
    """The resources of every trial of a study, so that trials compare. Raises InputError for invalid values.

    `large` is the network behind Large: without ImageNet weights of the full network the minimalistic one can
    replace it, then from scratch as well, so that the starting points differ in their weights alone.
    """

    ranges: str = option(
        "rendering_2", "scenes: a preset or the PATH of a TOML file of ranges", metavar="NAME|FILE"
    )
    size: int = option(64, "side of images in pixels", low=32, high=4096, metavar="N")
    batch_size: int = option(32, "images per step", low=1, metavar="N")
    steps: int = option(80, "steps of a trial", low=1, metavar="N")
    pictures: int = option(4096, "images to train on", low=1, metavar="N")
    validation: int = option(
        256, f"images to validate on, a multiple of {EVALUATION_BATCH}", low=1, metavar="N"
    )
    calibration: int = option(256, "images that batch normalisation is recalibrated on", low=1, metavar="N")
    silhouette_steps: int = option(
        0, "first steps, which see the leaf's silhouette in place of the image", low=0, metavar="N"
    )
    warm_start_steps: int = option(
        0, "steps of a short run of each starting point that its trials start from", low=0, metavar="N"
    )
    alpha: float = option(1.0, "width: factor on the number of channels", low=0.1, high=4.0, metavar="FACTOR")
    large: str = option("large", "network behind Large", choices=("large", "large_minimalistic"))
    weights_large: str = option(
        _IMAGENET, "weights of Large: imagenet, none or the path of a file", metavar="NAME|FILE"
    )
    weights_small: str = option(
        _IMAGENET, "weights of Small: imagenet, none or the path of a file", metavar="NAME|FILE"
    )

    def __post_init__(self) -> None:
        check_fields(self)
        if self.validation % EVALUATION_BATCH:
            raise InputError(f"validation = {self.validation} must be a multiple of {EVALUATION_BATCH}")
        # Of the images themselves: batch normalisation on silhouettes would not fit them.
        trained_on = (self.steps - self.silhouette_steps) * self.batch_size
        if self.calibration > trained_on:
            after = " after the silhouettes" if self.silhouette_steps else ""
            raise InputError(
                f"calibration = {self.calibration} must be at most the {max(0, trained_on)} images of all "
                f"steps{after}"
            )

    def config(self, point: Point, seed: int) -> TrainConfig:
        """Return the configuration with which `laesi_tf.train` trains `point`, there on fresh scenes."""
        weights = {"large_imagenet": self.weights_large, "small_imagenet": self.weights_small}
        return TrainConfig(
            backbone="small" if point.start == "small_imagenet" else self.large,
            alpha=self.alpha,
            size=(self.size, self.size),
            weights=weights.get(point.start, _FROM_SCRATCH),
            batch_size=self.batch_size,
            steps=self.steps,
            optimizer=point.optimizer,
            schedule=point.schedule,
            learning_rate=point.learning_rate,
            final_learning_rate=point.final_learning_rate,
            ranges=self.ranges,
            augment=",".join(point.augmentations),
            seed=seed,
            validate_every=self.steps,
            validation_pictures=self.validation,
        )

    def to_attributes(self) -> dict[str, Any]:
        """Return the study attribute of this budget, with the learning rates of the grid.

        Files are described by name and content, without their folder. Raises InputError for one that is
        missing.
        """
        weights = {
            name: _describe_weights(getattr(self, name)) for name in ("weights_large", "weights_small")
        }
        described = weights | {"ranges": _describe_ranges(self.ranges), "learning_rates": LEARNING_RATES}
        return dataclasses.asdict(self) | described


SCREENING = Budget()
"""For all points. A trial takes about eight seconds of one core, so that all 1,425 take two cores about an
hour and a half. In 40 steps hardly any point gets below the error of a constant guess; in 80 some do."""
FINAL = Budget(size=96, steps=240, pictures=8192, validation=512, calibration=512)
"""For the points that are repeated."""


def add_budget_arguments(parser: argparse.ArgumentParser, *presets: Budget) -> None:
    """Add an option for each field of Budget; an option that is not given leaves no attribute.

    The defaults that --help shows are those of `presets`: of the screening and of repeated points.
    """

    def describe_default(field: dataclasses.Field[Any]) -> str:
        first, *others = (format_default(getattr(preset, field.name)) for preset in presets)
        return (
            first if all(other == first for other in others) else f"{first}; for repeated points {others[0]}"
        )

    add_option_arguments(parser, Budget, describe_default=describe_default)


def budget_from_args(options: argparse.Namespace, preset: Budget) -> Budget:
    """Return `preset` with the values of the options that were given. Raises InputError."""
    names = [field.name for field in dataclasses.fields(Budget)]
    return dataclasses.replace(preset, **{name: vars(options)[name] for name in names if name in options})


def _describe_weights(weights: str) -> str:
    if weights in (_IMAGENET, _FROM_SCRATCH):
        return weights
    return _describe_file(
        weights, kind="weights file", advice="imagenet, none or the path of a .weights.h5 file"
    )


def _describe_ranges(ranges: str) -> str:
    if not ranges.endswith(".toml"):
        return ranges
    return _describe_file(
        ranges, kind="file of ranges", advice="the name of a preset or the path of a .toml file"
    )


def _describe_file(name: str, *, kind: str, advice: str) -> str:
    path = Path(name)
    if not path.is_file():
        raise InputError(f"no {kind} {path}; pass {advice}")
    return f"{path.name}, sha256 {short_sha256(path)}"
