"""Aggregate the metrics of jobs over seeds into rows of the table."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.experiment_specs import METRICS, Experiment
from experiments.paths import MEASURED, SETTINGS
from laesi_tf.common.atomic_files import read_json
from laesi_tf.common.errors import InputError

_SOURCES = {
    "val_mre": ("val", "mre"),
    "test_mre": ("test", "mre"),
    "miou": ("test", "miou"),
    "mpe": ("test", "mpe"),
}
"""Where a figure of the table stands in a trial's figures: masks are judged on the test photos."""


@dataclass(frozen=True)
class SeedStatistics:
    """A figure over seeds."""

    values: tuple[float, ...] = ()

    @property
    def mean(self) -> float | None:
        """None without a value."""
        return statistics.fmean(self.values) if self.values else None

    @property
    def deviation(self) -> float | None:
        """Standard deviation over seeds as a sample (n - 1); None for fewer than two."""
        return statistics.stdev(self.values) if len(self.values) > 1 else None


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """A row of the table at one count: ours over seeds, the paper's, both by FIGURES."""

    row: Experiment
    count: int
    ours: Mapping[str, SeedStatistics]
    refused: int
    """Photos on which no area was given, over seeds and splits."""
    origins: frozenset[str]
    """What its networks' weights started from."""

    @property
    def paper(self) -> Mapping[str, float]:
        """The paper's figures, those that it gives."""
        return self.row.paper.get(self.count, {})

    @property
    def planned(self) -> Sequence[str]:
        """The figures that it is to have: masks are learned at the row's first count alone."""
        return METRICS if self.count == self.row.counts[0] else METRICS[:2]

    @property
    def seeds(self) -> int:
        """How many seeds the figures are of, the most that any is of."""
        return max(len(cell.values) for cell in self.ours.values())


def read_settings(out: Path) -> Mapping[str, Any]:
    """What the experiments in `out` were made with. Raises InputError where there are none."""
    if not (out / SETTINGS).is_file():
        raise InputError(f"no experiments in {out}; run python -m experiments.run --out {out} first")
    return read_json(out / SETTINGS)


def collect_rows(out: Path, rows: Sequence[Experiment]) -> list[TableRow]:
    """A line for each row and count, with what is there of it. Raises InputError for broken figures."""
    return [_make_row(out, row, count) for row in rows for count in row.counts]


def _make_row(out: Path, row: Experiment, count: int) -> TableRow:
    found = [read_json(path) for path in sorted((out / f"{row.name}-{count}").glob(f"*/{MEASURED}"))]
    ours = {
        name: SeedStatistics(tuple(trial[split][key] for trial in found if trial[split][key] is not None))
        for name, (split, key) in _SOURCES.items()
    }
    # A mask network refuses every area; that is no news.
    refused = sum(
        trial[split]["refused"]
        for trial in found
        for split in ("val", "test")
        if trial[split]["mre"] is not None
    )
    origins = frozenset(trial["weights_origin"] for trial in found if "weights_origin" in trial)
    return TableRow(row=row, count=count, ours=ours, refused=refused, origins=origins)


def select_shown_rows(lines: Sequence[TableRow]) -> list[TableRow]:
    """The lines of the table: each row's first count, and others of which there is a figure."""
    return [
        line
        for line in lines
        if line.count == line.row.counts[0] or line.seeds or set(line.paper) & set(METRICS)
    ]
