"""The queue of a search: TPE proposes what to try, and trials with a high error are pruned.

The grid is compared with it: the lowest error against the number of trials, and of steps.
"""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import optuna
from optuna.trial import TrialState

from sweeps.queue import optuna_adapter
from sweeps.queue.study_storage import StudyStorage
from sweeps.queue.trial_queue import JOB, OBJECTIVES, SEED, ClaimedTrial, Job, TrialQueue

PRUNED_AT = "pruned_at"
"""User attribute: the step after which a trial was pruned."""
_STARTUP_TRIALS = 10
"""Random trials before TPE proposes and the pruner compares."""


class TpeQueue(TrialQueue):
    """The queue of the study `name` of up to `trials` trials, all with the same `seed` as the grid's.

    The error is its only objective: Optuna prunes by one. A failed trial is replaced by a new one.
    """

    can_prune = True

    def __init__(
        self,
        storage: StudyStorage,
        name: str,
        factors: Mapping[str, Sequence[str]],
        *,
        trials: int,
        seed: int,
    ) -> None:
        super().__init__(storage, name, objectives=OBJECTIVES[:1])
        self._factors, self._trials, self._seed = factors, trials, seed
        self.study.pruner = optuna.pruners.MedianPruner(n_startup_trials=_STARTUP_TRIALS)

    def claim(self) -> ClaimedTrial | None:
        """Claim a trial with the levels that TPE proposes; None if all trials are done or running."""
        with self.storage.lock():
            self._fail_stale_trials()
            counts = self.count_by_state()
            if sum(counts.values()) - counts[TrialState.FAIL] >= self._trials:
                return None
            with warnings.catch_warnings():
                # Optuna warns that nobody sends heartbeats for a trial of `ask`; the worker does.
                warnings.simplefilter("ignore", UserWarning)
                trial = self.study.ask()
            trial_id = optuna_adapter.trial_id(trial)
            optuna_adapter.send_heartbeat(self.storage.rdb, trial_id)
            # Each trial has its own seed: workers that start together must not propose the same.
            self.study.sampler = optuna.samplers.TPESampler(
                n_startup_trials=_STARTUP_TRIALS, constant_liar=True, seed=trial.number
            )
            levels = {
                factor: str(trial.suggest_categorical(factor, names))
                for factor, names in self._factors.items()
            }
            job = Job(f"{trial.number:04d}", levels, self._seed)
            trial.set_user_attr(JOB, job.name)
            trial.set_user_attr(SEED, job.seed)
        return ClaimedTrial(trial_id, trial.number, job)

    def is_finished(self) -> bool:
        """Return whether all trials are complete or pruned."""
        with self.storage.lock():
            self._fail_stale_trials()
        counts = self.count_by_state()
        return counts[TrialState.COMPLETE] + counts[TrialState.PRUNED] >= self._trials

    def expected_total(self) -> int:
        """Return the number of trials of the search."""
        return self._trials

    def should_prune(self, claim: ClaimedTrial, step: int, mre: float) -> bool:
        """Record a trial's error after `step` steps; return whether it is above the median of the others."""
        trial = optuna_adapter.resume_trial(self.study, claim.trial_id)
        trial.report(mre, step)
        return trial.should_prune()

    def finish(self, claim: ClaimedTrial, values: Sequence[float], attributes: Mapping[str, Any]) -> bool:
        """End the trial as pruned if `attributes` have PRUNED_AT, else as complete."""
        state = TrialState.PRUNED if PRUNED_AT in attributes else TrialState.COMPLETE
        with self.storage.lock():
            return self._end_trial(claim.trial_id, state, attributes, values[:1])

    def _fail_stale_trials(self) -> None:
        """Fail stale trials, and those whose claim was interrupted.

        The latter may have no heartbeat, and Optuna would count them as alive for ever. No other trial lacks
        a seed while the lock is held.
        """
        super()._fail_stale_trials()
        for trial in self.get_trials():
            if trial.state is TrialState.RUNNING and SEED not in trial.user_attrs:
                self._fail_trial(optuna_adapter.trial_id(trial), "the claim was interrupted", counts=False)
