"""Trials of a study as CSV, written and read."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optuna.trial import FrozenTrial, TrialState

from laesi_tf.common.atomic_files import write_csv
from laesi_tf.common.errors import InputError
from sweeps.queue.job_selection import parse_job_name
from sweeps.queue.tpe_queue import PRUNED_AT
from sweeps.queue.trial_queue import JOB, REASON, SEED
from sweeps.trials.search_space import FACTORS, POINTS, Point

_ATTRIBUTES = ("median", "p90", "final_loss", "images_per_s", "parameters", "steps_s", "trial_s", "attempt")
_HEADER = ("number", *FACTORS, "replicate", "seed", "mre", "inference_ms", PRUNED_AT, *_ATTRIBUTES)


@dataclass(frozen=True)
class TrialRecord:
    """A trial that ended: its point's number, its MRE in percent, the step it was pruned after or 0.

    Trials of one `replicate` have the same seed, except those that diverged and got another.
    """

    number: int
    point: Point
    seed: int
    mre: float
    inference_ms: float
    pruned_at: int = 0
    replicate: int = 0


def write_trials(path: Path, trials: Iterable[FrozenTrial]) -> int:
    """Write the complete and pruned trials of a study, in the order of their ends; return how many."""
    ended = [trial for trial in trials if trial.state in (TrialState.COMPLETE, TrialState.PRUNED)]
    in_order = sorted(ended, key=lambda trial: trial.datetime_complete or trial.number)
    write_csv(path, _HEADER, [_format_trial(trial) for trial in in_order])
    return len(in_order)


def write_failures(path: Path, trials: Iterable[FrozenTrial]) -> int:
    """Write the failed attempts of a study with their reasons; return how many."""
    failed = [trial for trial in trials if trial.state is TrialState.FAIL]
    columns = [JOB, SEED, REASON]
    write_csv(path, columns, [[trial.user_attrs.get(name) for name in columns] for trial in failed])
    return len(failed)


def read_trials(path: Path) -> list[TrialRecord]:
    """Read a CSV that `write_trials` wrote. Raises InputError for any other file."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return [_parse_record(cells) for cells in csv.DictReader(file)]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{path} is not a table of trials: {error!r}; write it again with --storage"
        ) from error


def _format_trial(trial: FrozenTrial) -> Sequence[Any]:
    point = Point(**{factor: trial.params[factor] for factor in FACTORS})
    attributes = trial.user_attrs
    # A search has one objective and stores the other as an attribute.
    inference_ms = trial.values[1] if len(trial.values) > 1 else attributes["inference_ms"]
    _, replicate = parse_job_name(attributes[JOB])
    return [
        POINTS.index(point),
        *point.levels.values(),
        replicate,
        attributes[SEED],
        round(trial.values[0], 6),
        _round(inference_ms),
        attributes.get(PRUNED_AT),
        *(_round(attributes.get(name)) for name in _ATTRIBUTES),
    ]


def _round(value: Any) -> Any:
    return round(value, 5) if isinstance(value, float) else value


def _parse_record(cells: dict[str, str]) -> TrialRecord:
    point = Point(**{factor: cells[factor] for factor in FACTORS})
    if POINTS[int(cells["number"])] != point:
        raise ValueError(f"point {cells['number']} has other levels")
    return TrialRecord(
        number=int(cells["number"]),
        point=point,
        seed=int(cells["seed"]),
        mre=float(cells["mre"]),
        inference_ms=float(cells["inference_ms"]),
        pruned_at=int(cells[PRUNED_AT] or 0),
        replicate=int(cells["replicate"]),
    )
