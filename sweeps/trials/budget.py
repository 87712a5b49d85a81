"""Resources of a trial: image size, numbers of images and steps, initial weights."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.errors import InputError
from laesi_tf.models.backbone import FROM_SCRATCH
from laesi_tf.training.config import TrainConfig
from sweeps.trials.search_space import FINAL_LEARNING_RATE, LEARNING_RATE, Point

EVALUATION_BATCH = 64
"""Validation pictures that a network sees at once; each other size would be traced anew."""


def _field(default: Any, text: str) -> Any:
    return dataclasses.field(default=default, metadata={"help": text})


@dataclass(frozen=True)
class Budget:
    """The same for all trials of a study, so that they compare. Raises InputError for what does not fit.

    `large` is the network behind Large: without ImageNet weights of the full one the minimalistic one stands
    in, and then from scratch as well, so that the starting points differ in their weights alone.
    """

    size: int = _field(64, "side of pictures in pixels")
    batch_size: int = _field(32, "pictures per step")
    steps: int = _field(80, "steps of a trial")
    pictures: int = _field(4096, "pictures to train on")
    validation: int = _field(256, f"pictures to judge by, a multiple of {EVALUATION_BATCH}")
    calibration: int = _field(256, "pictures that batch normalisation is recalibrated on")
    alpha: float = _field(1.0, "width: factor on the number of channels")
    large: str = _field("large", "network behind Large, large or large_minimalistic")
    weights_large: str = _field("imagenet", "weights of Large: imagenet, none or the path of a file")
    weights_small: str = _field("imagenet", "weights of Small: imagenet, none or the path of a file")

    def __post_init__(self) -> None:
        if self.large not in ("large", "large_minimalistic"):
            raise InputError(f"--large {self.large!r} is neither large nor large_minimalistic")
        if self.validation % EVALUATION_BATCH:
            raise InputError(
                f"{self.validation} validation pictures are not a multiple of {EVALUATION_BATCH}"
            )
        if self.calibration > self.steps * self.batch_size:
            fed = self.steps * self.batch_size
            raise InputError(f"{self.calibration} calibration pictures are more than the {fed} trained on")

    def config(self, point: Point, seed: int) -> TrainConfig:
        """How `laesi_tf.train` would be told to train `point`; there on live scenes instead of kept ones."""
        weights = {"large_imagenet": self.weights_large, "small_imagenet": self.weights_small}
        return TrainConfig(
            backbone="small" if point.start == "small_imagenet" else self.large,
            alpha=self.alpha,
            size=(self.size, self.size),
            weights=weights.get(point.start, FROM_SCRATCH),
            batch_size=self.batch_size,
            steps=self.steps,
            optimizer=point.optimizer,
            schedule=point.schedule,
            learning_rate=LEARNING_RATE,
            final_learning_rate=FINAL_LEARNING_RATE,
            augment=",".join(point.augmentations),
            seed=seed,
            validate_every=self.steps,
            validation_pictures=self.validation,
        )

    def told(self) -> dict[str, Any]:
        """The budget as a study keeps it: files of weights by name and content, not by where they lie."""
        weights = {
            name: _describe_weights(getattr(self, name)) for name in ("weights_large", "weights_small")
        }
        return dataclasses.asdict(self) | weights


SCREENING = Budget()
FINAL = Budget(size=96, steps=240, pictures=8192, validation=512, calibration=512)
"""What all points are tried with, and some of them again.

A screening trial takes some eight seconds of one core, so that all 1,425 take two cores about an hour and a
half. In 40 steps hardly a point gets below the error of a single guess for all pictures; in 80 some do.
"""


def _describe_weights(weights: str) -> str:
    if weights in ("imagenet", FROM_SCRATCH):
        return weights
    path = Path(weights)
    if not path.is_file():
        raise InputError(f"no weights file {path}; pass imagenet, none or the path of a .weights.h5 file")
    return f"{path.name}, sha256 {short_sha256(path)}"
