"""What a search finds for what it spends: TPE against the grid in any order.

On the complete grid a search can be replayed: what it proposes has been tried, with the very seed a new trial
would have. So TPE is judged by many replays, not by one run; a run with pruning is shown as it went.
"""

import warnings
from collections.abc import Sequence

import numpy as np
import optuna
from scipy import stats

from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import FACTORS, POINTS, Point


def random_search_quantiles(errors: np.ndarray, count: int, quantiles: Sequence[float]) -> np.ndarray:
    """Quantiles [Q, count] of the lowest error after 1.. `count` points of the grid in random order."""
    ordered, total = np.sort(errors), len(errors)
    drawn = np.arange(1, count + 1)
    # The lowest is above the k-th smallest if none of the k smallest is among those drawn.
    above = stats.hypergeom.pmf(0, total, np.arange(1, total + 1)[:, None], drawn[None])
    return np.array([ordered[np.argmax(1 - above >= q, axis=0)] for q in quantiles])


def replay_tpe(rows: Sequence[TrialRecord], count: int, replays: int) -> np.ndarray:
    """The lowest error [replays, count] that TPE has found after 1.. `count` trials, replayed on the grid."""
    errors = {row.point: row.mre for row in rows}
    found = np.empty((replays, count))
    for replay in range(replays):
        sampler = optuna.samplers.TPESampler(seed=replay)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            study = optuna.create_study(sampler=sampler)

        def objective(trial: optuna.Trial) -> float:
            levels = {name: trial.suggest_categorical(name, levels) for name, levels in FACTORS.items()}
            return errors[Point(**levels)]

        study.optimize(objective, n_trials=count)
        found[replay] = np.minimum.accumulate(np.array([trial.value for trial in study.trials], np.float64))
    return found


def running_best(rows: Sequence[TrialRecord], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a search as it went: steps spent after each trial [N], and the lowest error of complete ones [N]."""
    spent = np.cumsum([row.pruned_at or steps for row in rows])
    errors = [np.inf if row.pruned_at else row.mre for row in rows]
    return spent, np.minimum.accumulate(errors)


def is_complete_grid(rows: Sequence[TrialRecord]) -> bool:
    """Whether every point of the grid is there."""
    return {row.number for row in rows} == set(range(len(POINTS)))
