"""The experiments of the paper's table as configs/ specifies them, their jobs, and the shared recipe."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from laesi_tf.common import schema
from laesi_tf.common.errors import InputError
from laesi_tf.training import config_files
from laesi_tf.training.config import TrainConfig

_FOLDER = Path(__file__).parent
METRICS = ("val_mre", "test_mre", "miou", "mpe")
"""Columns of the paper's table 1: MRE in percent, mIoU and mask pixel error as fractions."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One experiment: what the networks are trained on besides the real photos."""

    name: str
    """The name of its file without the number that orders the files."""
    title: str
    data_type: str
    """rule_based: nothing is trained; photos: real photos alone; scenes: rendered scenes too; records: a data
    set that exists already too."""
    counts: tuple[int, ...]
    """Numbers of synthetic images; the first is the table's, all are in the chart."""
    ranges: str = ""
    """Ranges of the scenes: a preset, or a file in this folder."""
    folder: str = ""
    """Folder of the records within that of all data sets."""
    paper: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    """The paper's results by count, with keys from METRICS."""

    @property
    def scene_ranges(self) -> str | Path:
        """The argument of `load_ranges` for its scenes."""
        return _FOLDER / self.ranges if self.ranges.endswith(".toml") else self.ranges

    @property
    def tasks(self) -> tuple[str, ...]:
        """Tasks of its first count; the rules measure area and mask at once."""
        return ("area",) if self.data_type == "rule_based" else ("area", "mask")


@dataclass(frozen=True, kw_only=True)
class Job:
    """One training, or one measurement by rules, of an experiment."""

    experiment: Experiment
    count: int
    task: str
    seed: int

    @property
    def group(self) -> str:
        """Folder of the jobs that use the same data."""
        return f"{self.experiment.name}-{self.count}"

    @property
    def folder(self) -> Path:
        """Its run directory within the folder of all runs."""
        return Path(self.group) / f"{self.task}-{self.seed}"

    def __str__(self) -> str:
        return f"{self.experiment.name}, {self.count} synthetic, {self.task}, seed {self.seed}"


def load_experiments(names: Sequence[str] = ()) -> list[Experiment]:
    """Return all experiments, or those of `names`, in the table's order. Raises InputError."""
    paths = {path.stem.split("_", 1)[1]: path for path in sorted((_FOLDER / "configs").glob("*.toml"))}
    for name in names:
        if name not in paths:
            raise InputError(f"unknown experiment {name!r}; choose from {', '.join(paths)}")
    return [_parse_experiment(name, path) for name, path in paths.items() if not names or name in names]


def _parse_experiment(name: str, path: Path) -> Experiment:
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    return Experiment(
        name=name,
        data_type=values.pop("kind"),
        counts=tuple(values.pop("counts")),
        paper={int(count): metrics for count, metrics in values.pop("paper").items()},
        **values,
    )


def plan_jobs(experiments: Sequence[Experiment], *, seeds: int) -> list[Job]:
    """Return the jobs, ordered by seed so that every row gets its first result early.

    Masks are trained at the first count alone: the chart over counts shows areas.
    """
    return [
        Job(experiment=experiment, count=count, task=task, seed=seed)
        for seed in range(seeds)
        for experiment in experiments
        for count in experiment.counts
        for task in (experiment.tasks if count == experiment.counts[0] else ("area",))
    ]


def shorten(count: int, scale: float) -> int:
    """Return the number of images or steps of an experiment shortened to `scale`, 0 < `scale` <= 1."""
    return math.ceil(count * scale)


def job_config(task: str, *, scale: float, **values: Any) -> TrainConfig:
    """Return the recipe's configuration for `task`, shortened to `scale`, with `values` on top.

    The side shrinks with the square root of `scale`, to a multiple of 32 pixels.
    """
    recipe = schema.read_toml(_FOLDER / "recipe.toml")
    keys = recipe["shared"] | recipe[task] | {"task": task} | values
    keys["size"] = max(32, round(keys["size"] * math.sqrt(scale) / 32) * 32)
    for name in ("steps", "validate_every", "checkpoint_every"):
        keys[name] = shorten(keys[name], scale)
    return config_files.config_from_dict(keys)
