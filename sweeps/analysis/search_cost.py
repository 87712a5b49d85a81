"""What a search finds for its cost: TPE against the grid in random order.

On the complete grid a search can be replayed: every proposal has been tried, with the seed that a new trial
would have. TPE is therefore compared by many replays instead of one run; the run with pruning is shown as it
is.
"""

import warnings
from collections.abc import Sequence

import numpy as np
import optuna
from scipy import stats

from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import FACTORS, POINTS, Point


def random_search_quantiles(errors: np.ndarray, count: int, quantiles: Sequence[float]) -> np.ndarray:
    """Return quantiles [Q, count] of the lowest error after 1 to `count` points in random order."""
    ordered, total = np.sort(errors), len(errors)
    drawn = np.arange(1, count + 1)
    # The lowest is above the k-th smallest error if none of the k smallest is among those drawn.
    above = stats.hypergeom.pmf(0, total, np.arange(1, total + 1)[:, None], drawn[None])
    return np.array([ordered[np.argmax(1 - above >= q, axis=0)] for q in quantiles])


def replay_tpe(records: Sequence[TrialRecord], count: int, replays: int) -> np.ndarray:
    """Replay TPE on the grid; return its lowest error [replays, count] after 1 to `count` trials."""
    errors = {record.point: record.mre for record in records}

    def objective(trial: optuna.Trial) -> float:
        levels = {name: str(trial.suggest_categorical(name, names)) for name, names in FACTORS.items()}
        return errors[Point(**levels)]

    lowest = np.empty((replays, count))
    for replay in range(replays):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=replay))
        study.optimize(objective, n_trials=count)
        lowest[replay] = np.minimum.accumulate([trial.values[0] for trial in study.trials])
    return lowest


def accumulate_lowest(records: Sequence[TrialRecord], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return, after each trial of a search, the steps spent [N] and the lowest error of complete trials [N].

    `steps` are those of a complete trial.
    """
    spent = np.cumsum([record.pruned_at or steps for record in records])
    errors = [np.inf if record.pruned_at else record.mre for record in records]
    return spent, np.minimum.accumulate(errors)


def is_complete_grid(records: Sequence[TrialRecord]) -> bool:
    """Return whether `records` cover every point of the grid."""
    return {record.number for record in records} == set(range(len(POINTS)))
