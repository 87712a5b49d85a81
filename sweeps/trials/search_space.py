"""The 1,425 points of the search: 3 starting points x 5 optimizers x 5 schedules x 19 augmentation sets.

The paper says that 1,425 experiments were made and names the levels of the best (section 4.2); the supplement
with the full matrix is empty. This is a matrix of that size around that optimum. The reasons:

* Starting points: the paper varies MobileNetV3 Large and Small and starts its best model from ImageNet.
  Large is also trained from scratch, which shows what the pretraining is worth; Small from scratch would
  answer the same question again.
* Optimizers: the paper's RMSprop, which MobileNets were trained with; Adam and AdamW, the usual choice today
  with and without decoupled weight decay; SGD with Nesterov momentum, the classic of image recognition;
  Nadam, Adam with that momentum. Each has a learning rate that suits it: at the paper's 1e-3, which suits
  RMSprop, SGD reached an MRE of 6,438 %.
* Schedules: piecewise constant, from 1e-3 to 1e-9 with RMSprop as in the paper and in the same ratio with the
  others, and four others with the same ends.
  Exponential falls through the same range without plateaus; cosine with a warm-up and linear are the usual
  ones today and stay high for longer; constant is the control without decay.
* Augmentations: none and all nine are the ends, the paper's seven its choice. Each of the nine alone shows
  its own effect, the seven without one what each adds to the rest.
"""

import dataclasses
import itertools
from dataclasses import dataclass

STARTS = ("large_imagenet", "small_imagenet", "large_scratch")
LEARNING_RATES = {"rmsprop": 1e-3, "adam": 3e-3, "adamw": 3e-3, "sgd": 0.3, "nadam": 3e-3}
"""The highest rate of each optimizer: the paper's of RMSprop, and what `python -m sweeps.learning_rates
--ranges sweeps/scenes/fixed_scale.toml --steps 60 --pictures 2048 --seeds 1` with the minimalistic Large
found on 2026-11-30 (93 trials from three starting points with seed 0, two cores of an AMD EPYC). It found the
paper's rate for RMSprop, too. The trials are in sweeps/results/learning_rates.csv."""
FINAL_RATIO = 1e-6
"""The last learning rate over the first, as in the paper: from 1e-3 to 1e-9."""


_NINE = (
    *("brightness", "contrast", "hue", "saturation", "flip"),
    *("rotation90", "rotation", "gaussian", "poisson"),
)
"""The paper's augmentations, by name: a tenth that is registered later must not change the points."""


def _make_augmentation_sets() -> dict[str, tuple[str, ...]]:
    seven = tuple(name for name in _NINE if name not in ("rotation", "gaussian"))
    alone = {name: (name,) for name in _NINE}
    without = {f"paper_less_{left_out}": tuple(n for n in seven if n != left_out) for left_out in seven}
    return {"none": (), "all": _NINE, "paper": seven, **alone, **without}


AUGMENTATION_SETS = _make_augmentation_sets()
"""The augmentations of each set, by its name."""

FACTORS: dict[str, tuple[str, ...]] = {
    "start": STARTS,
    "optimizer": ("rmsprop", "adam", "adamw", "sgd", "nadam"),
    "schedule": ("piecewise", "exponential", "cosine", "linear", "constant"),
    "augmentation": tuple(AUGMENTATION_SETS),
}
"""The levels of each factor; the points are all combinations, the last factor varying fastest."""


@dataclass(frozen=True)
class Point:
    """One way to train: a level of every factor."""

    start: str
    optimizer: str
    schedule: str
    augmentation: str

    @property
    def levels(self) -> dict[str, str]:
        """The level of each factor."""
        return dataclasses.asdict(self)

    def __str__(self) -> str:
        return ", ".join(self.levels.values())

    @property
    def learning_rate(self) -> float:
        """The highest learning rate, that of its optimizer."""
        return LEARNING_RATES[self.optimizer]

    @property
    def final_learning_rate(self) -> float:
        """The lowest learning rate of a schedule that falls; the constant one stays at the highest."""
        return FINAL_RATIO * self.learning_rate

    @property
    def augmentations(self) -> tuple[str, ...]:
        """The names of the augmentations in its set."""
        return AUGMENTATION_SETS[self.augmentation]


POINTS: tuple[Point, ...] = tuple(Point(*levels) for levels in itertools.product(*FACTORS.values()))
"""All 1,425, in the order of their numbers."""
OPTIMUM = Point("large_imagenet", "rmsprop", "piecewise", "paper")
"""The paper's best point."""
