"""Aggregate the metrics of jobs over seeds into rows of the table."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from experiments.experiment_specs import METRICS, Experiment
from experiments.paths import MEASURED, SETTINGS
from laesi_tf.common.atomic_files import read_json
from laesi_tf.common.errors import InputError

_SOURCES = {
    "val_mre": ("area", "val", "mre"),
    "test_mre": ("area", "test", "mre"),
    "miou": ("mask", "test", "miou"),
    "mpe": ("mask", "test", "mpe"),
}
"""Task, split and key of each metric in the metrics of a job; masks are evaluated on the test photos."""


@dataclass(frozen=True)
class SeedStatistics:
    """A metric over seeds: the values of those of `jobs` that have one; others refused every photo."""

    values: tuple[float, ...] = ()
    jobs: int = 0

    @property
    def mean(self) -> float | None:
        """None without a value."""
        return statistics.fmean(self.values) if self.values else None

    @property
    def deviation(self) -> float | None:
        """Standard deviation of the seeds as a sample (n - 1); None for fewer than two."""
        return statistics.stdev(self.values) if len(self.values) > 1 else None


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """A row of the table at one count: our metrics over seeds and the paper's, with keys from METRICS."""

    experiment: Experiment
    count: int
    ours: Mapping[str, SeedStatistics]
    refused: int
    """Photos for which no area was given, over seeds and splits."""
    origins: frozenset[str]
    """Initial weights of its networks."""

    @property
    def paper(self) -> Mapping[str, float]:
        """The metrics that the paper gives."""
        return self.experiment.paper.get(self.count, {})

    @property
    def planned_metrics(self) -> Sequence[str]:
        """The metrics that the row is to have: masks are trained at the first count alone."""
        return METRICS if self.count == self.experiment.counts[0] else METRICS[:2]

    @property
    def seeds(self) -> int:
        """The number of seeds that were run, the largest over the metrics."""
        return max(metric.jobs for metric in self.ours.values())


def read_settings(out: Path) -> Mapping[str, Any]:
    """Read the settings of the experiments in `out`. Raises InputError if there are none."""
    if not (out / SETTINGS).is_file():
        raise InputError(f"no experiments in {out}; run python -m experiments.run --out {out} first")
    return cast(Mapping[str, Any], read_json(out / SETTINGS))


def collect_rows(out: Path, experiments: Sequence[Experiment]) -> list[TableRow]:
    """Return a row for each experiment and count, with what has been measured. Raises InputError."""
    return [_make_row(out, experiment, count) for experiment in experiments for count in experiment.counts]


def _make_row(out: Path, experiment: Experiment, count: int) -> TableRow:
    by_task = {
        task: [
            read_json(path)
            for path in sorted((out / f"{experiment.name}-{count}").glob(f"{task}-*/{MEASURED}"))
        ]
        for task in ("area", "mask")
    }
    ours = {}
    for name, (task, split, key) in _SOURCES.items():
        # The rules measure areas and masks in one job.
        jobs = by_task[task if task in experiment.tasks else "area"]
        values = [job[split][key] for job in jobs]
        ours[name] = SeedStatistics(tuple(value for value in values if value is not None), len(jobs))
    return TableRow(
        experiment=experiment,
        count=count,
        ours=ours,
        refused=sum(job[split]["refused"] for job in by_task["area"] for split in ("val", "test")),
        origins=frozenset(
            job["weights_origin"] for jobs in by_task.values() for job in jobs if "weights_origin" in job
        ),
    )


def select_shown_rows(rows: Sequence[TableRow]) -> list[TableRow]:
    """Return the rows of the table: first counts, and others with a result of ours or the paper's."""
    return [
        row
        for row in rows
        if row.count == row.experiment.counts[0] or row.seeds or set(row.paper) & set(METRICS)
    ]
