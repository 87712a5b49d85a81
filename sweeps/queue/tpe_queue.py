"""A free search of the same space: TPE proposes what to try, and what looks hopeless is pruned.

It is what the grid is compared with: the lowest error against the trials, and the steps, that were spent.
"""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import optuna
from optuna.trial import TrialState

from sweeps.queue.study_storage import StudyStorage
from sweeps.queue.trial_queue import JOB, OBJECTIVES, SEED, ClaimedTrial, Job, TrialQueue

PRUNED_AT = "pruned_at"
"""User attribute: after how many steps a trial was pruned."""
_STARTUP_TRIALS = 10
"""Random trials before anything is concluded from them."""


class TpeQueue(TrialQueue):
    """The study `name` of up to `trials` trials, which all have the same `seed` as the grid's.

    It has the error for its only objective: Optuna prunes by one. Failed trials are replaced by new ones.
    """

    def __init__(
        self, store: StudyStorage, name: str, factors: Mapping[str, Sequence[str]], *, trials: int, seed: int
    ) -> None:
        super().__init__(store, name, objectives=OBJECTIVES[:1])
        self._factors, self._wanted, self._seed = factors, trials, seed
        self.study.pruner = optuna.pruners.MedianPruner(n_startup_trials=_STARTUP_TRIALS)

    def claim(self) -> ClaimedTrial | None:
        """A trial with the levels that TPE proposes; None if as many as are wanted are done or under way."""
        with self.store.lock():
            self._fail_lost()
            counts = self.counts()
            if sum(counts.values()) - counts[TrialState.FAIL] >= self._wanted:
                return None
            with warnings.catch_warnings():
                # Optuna warns that no one sends heartbeats for a trial that was asked for: the worker does.
                warnings.simplefilter("ignore", UserWarning)
                trial = self.study.ask()
            self.store.storage.record_heartbeat(trial._trial_id)
            # A seed of the trial's own: workers that begin together must not propose the same.
            self.study.sampler = optuna.samplers.TPESampler(
                n_startup_trials=_STARTUP_TRIALS, constant_liar=True, seed=trial.number
            )
            levels = {name: trial.suggest_categorical(name, found) for name, found in self._factors.items()}
            job = Job(f"{trial.number:04d}", levels, self._seed)
            trial.set_user_attr(JOB, job.name)
            trial.set_user_attr(SEED, job.seed)
        return ClaimedTrial(trial._trial_id, trial.number, job)

    def finished(self) -> bool:
        """Whether as many trials as are wanted have ended well."""
        with self.store.lock():
            self._fail_lost()
        counts = self.counts()
        return counts[TrialState.COMPLETE] + counts[TrialState.PRUNED] >= self._wanted

    def hopeless(self, claim: ClaimedTrial, step: int, mre: float) -> bool:
        """Whether a trial with this error after `step` steps is worse than half of the others were then."""
        trial = optuna.Trial(self.study, claim.trial_id)
        trial.report(mre, step)
        return trial.should_prune()

    def finish(self, claim: ClaimedTrial, values: Sequence[float], attributes: Mapping[str, Any]) -> bool:
        """End the trial as complete, or as pruned where it says after how many steps."""
        state = TrialState.PRUNED if PRUNED_AT in attributes else TrialState.COMPLETE
        with self.store.lock():
            return self._end(claim.trial_id, state, attributes, values[:1])

    def _fail_lost(self) -> None:
        """As in any book, and those that a worker began to claim and did not get to the end of it.

        They may have no heartbeat, and Optuna would take them for alive for ever. Under the lock there are no
        others without a seed.
        """
        super()._fail_lost()
        for trial in self.trials():
            if trial.state is TrialState.RUNNING and SEED not in trial.user_attrs:
                self._fail(trial._trial_id, "the claim was not finished", counts=False)
