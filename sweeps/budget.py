"""What a trial may spend: how large, how many and which pictures, how many steps, from which weights."""

import dataclasses
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from laesi_tf.config import TrainConfig
from laesi_tf.errors import InputError
from laesi_tf.models.backbone import FROM_SCRATCH
from sweeps.grid import FINAL_LEARNING_RATE, LEARNING_RATE, Point

JUDGED_BATCH = 64
"""Validation pictures that a network sees at once; each other size would be traced anew."""


@dataclass(frozen=True)
class Budget:
    """The same for all trials of a study, so that they compare. Raises InputError for what does not fit.

    `calibration` pictures re-estimate batch normalisation before a network is judged. `large` is the network
    behind Large: without ImageNet weights of the full one the minimalistic one stands in, and then from
    scratch as well, so that the starting points differ in their weights alone.
    """

    size: int = 64
    batch_size: int = 32
    steps: int = 40
    pictures: int = 4096
    validation: int = 256
    calibration: int = 256
    alpha: float = 1.0
    large: str = "large"
    weights_large: str = "imagenet"
    weights_small: str = "imagenet"

    def __post_init__(self) -> None:
        if self.validation % JUDGED_BATCH:
            raise InputError(f"{self.validation} validation pictures are not a multiple of {JUDGED_BATCH}")
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
        weights = {name: _origin(getattr(self, name)) for name in ("weights_large", "weights_small")}
        return dataclasses.asdict(self) | weights


SCREENING = Budget()
FINAL = Budget(size=96, steps=240, pictures=8192, validation=512, calibration=512)
"""What all points are tried with, and the best of them again."""


def _origin(weights: str) -> str:
    if weights in ("imagenet", FROM_SCRATCH):
        return weights
    path = Path(weights)
    if not path.is_file():
        raise InputError(f"no weights file {path}; pass imagenet, none or the path of a .weights.h5 file")
    return f"{path.name}, sha256 {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}"
