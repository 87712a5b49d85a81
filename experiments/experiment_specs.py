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

HERE = Path(__file__).parent
METRICS = ("val_mre", "test_mre", "miou", "mpe")
"""Columns of the paper's table 1: MRE in percent, mIoU and mask pixel error as fractions."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One experiment: what the networks see beside the real photos."""

    name: str
    """Its file's name without the number that puts it in order."""
    title: str
    kind: str
    """rule_based: nothing is trained; photos: real ones alone; scenes: and rendered ones; records: and a data
    set that is there already."""
    counts: tuple[int, ...]
    """Synthetic pictures; the first count is the table's, all are the figure's."""
    ranges: str = ""
    """What scenes are drawn from: a preset, or a file beside this module."""
    folder: str = ""
    """Folder of the records below that of all data sets."""
    paper: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    """The paper's figures by count, keys from FIGURES."""

    @property
    def scenes(self) -> str | Path:
        """`ranges` as `load_ranges` takes them."""
        return HERE / self.ranges if self.ranges.endswith(".toml") else self.ranges


@dataclass(frozen=True, kw_only=True)
class Job:
    """One training, or one measurement by rules, of a row."""

    row: Experiment
    count: int
    task: str
    seed: int

    @property
    def group(self) -> str:
        """Folder of the trials that go by the same data."""
        return f"{self.row.name}-{self.count}"

    @property
    def folder(self) -> Path:
        """Its run's folder below that of all runs."""
        return Path(self.group) / f"{self.task}-{self.seed}"

    def __str__(self) -> str:
        return f"{self.row.name}, {self.count} synthetic, {self.task}, seed {self.seed}"


def load_experiments(names: Sequence[str] = ()) -> list[Experiment]:
    """The rows, or those of `names`, in the table's order. Raises InputError for an unknown name."""
    paths = {path.stem.split("_", 1)[1]: path for path in sorted((HERE / "configs").glob("*.toml"))}
    for name in names:
        if name not in paths:
            raise InputError(f"unknown experiment {name!r}; choose from {', '.join(paths)}")
    return [_parse_experiment(name, path) for name, path in paths.items() if not names or name in names]


def _parse_experiment(name: str, path: Path) -> Experiment:
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    paper = {int(count): figures for count, figures in values.pop("paper").items()}
    return Experiment(name=name, counts=tuple(values.pop("counts")), paper=paper, **values)


def plan_jobs(rows: Sequence[Experiment], *, seeds: int) -> list[Job]:
    """All that is to be done, seed by seed, so that the table fills evenly.

    Masks are learned at the first count alone: the figure over the counts is one of areas. Rules measure both
    at once.
    """
    return [
        Job(row=row, count=count, task=task, seed=seed)
        for seed in range(seeds)
        for row in rows
        for count in row.counts
        for task in (("area", "mask") if count == row.counts[0] and row.kind != "rule_based" else ("area",))
    ]


def shorten(count: int, scale: float) -> int:
    """`count` pictures or steps of an experiment shortened to `scale`, 0 < `scale` <= 1; 0 stays 0."""
    return math.ceil(count * scale)


def job_config(task: str, *, scale: float, **values: Any) -> TrainConfig:
    """The recipe's configuration for `task`, shortened to `scale`, with `values` besides.

    The side shrinks with the root of `scale`, to a multiple of 32 pixels.
    """
    recipe = schema.read_toml(HERE / "recipe.toml")
    keys = recipe["shared"] | recipe[task] | {"task": task} | values
    keys["size"] = max(32, round(keys["size"] * math.sqrt(scale) / 32) * 32)
    for name in ("steps", "validate_every", "checkpoint_every"):
        keys[name] = shorten(keys[name], scale)
    return config_files.config_from_dict(keys)
