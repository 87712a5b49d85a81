"""The base class of the queues that workers share: claims, results and counts of a study's trials.

`GridQueue` queues the jobs of failed and lost trials again; `TpeQueue` proposes new trials in their place.
"""

import abc
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import optuna
from optuna.exceptions import ExperimentalWarning, UpdateFinishedTrialError
from optuna.trial import FrozenTrial, TrialState

from laesi_tf.common.errors import InputError
from sweeps.queue import optuna_adapter
from sweeps.queue.study_storage import StudyStorage

OBJECTIVES = ("MRE, %", "inference, ms")
JOB, SEED, REASON, COUNTS = "job", "seed", "reason", "counts"
"""User attributes: a trial's job and seed; why it failed, and whether that counts against its job."""
LOST = "worker lost: no heartbeat for {} s"
_USED_STATES = (TrialState.RUNNING, TrialState.COMPLETE, TrialState.PRUNED)


@dataclass(frozen=True)
class Job:
    """A level of every factor, and the seed to train with."""

    name: str
    levels: Mapping[str, str]
    seed: int


@dataclass(frozen=True)
class ClaimedTrial:
    """A trial that one worker has claimed, and why earlier attempts at its job failed."""

    trial_id: int
    number: int
    job: Job
    reasons: tuple[str, ...] = ()

    @property
    def attempt(self) -> int:
        """The number of this attempt, from 1."""
        return len(self.reasons) + 1


class TrialQueue(abc.ABC):
    """The study `name` in a storage, created if it is missing; workers claim trials and record results.

    Methods that several workers call at once do what must not be interleaved under the storage's lock.
    """

    can_prune = False
    """Whether `should_prune` may ever return true, so that intermediate errors are worth measuring."""

    def __init__(self, storage: StudyStorage, name: str, *, objectives: Sequence[str] = OBJECTIVES) -> None:
        self.storage, self.name = storage, name
        with storage.lock(), warnings.catch_warnings():
            warnings.simplefilter("ignore", ExperimentalWarning)
            self.study = optuna.create_study(
                storage=storage.rdb,
                study_name=name,
                directions=["minimize"] * len(objectives),
                load_if_exists=True,
            )
            self.study.set_metric_names(list(objectives))
        self.study_id = optuna_adapter.study_id(storage.rdb, name)

    @abc.abstractmethod
    def claim(self) -> ClaimedTrial | None:
        """Claim the next trial for this worker; None if there is none at the moment."""

    @abc.abstractmethod
    def is_finished(self) -> bool:
        """Return whether no trial is waiting or running."""

    @abc.abstractmethod
    def expected_total(self) -> int:
        """Return how many trials complete or are pruned if none is given up."""

    def list_given_up(self) -> dict[str, list[str]]:
        """Return the reasons of each job that failed too often to be retried, by the job's name."""
        return {}

    def should_prune(self, claim: ClaimedTrial, step: int, mre: float) -> bool:
        """Record a trial's error after `step` steps; return whether it is too high to continue."""
        return False

    def check_study_setting(self, key: str, value: Mapping[str, Any]) -> None:
        """Store `value` with the study; raise InputError if trials have already used another value."""
        with self.storage.lock():
            attributes = self.storage.rdb.get_study_user_attrs(self.study_id)
            stored, counts = attributes.get(key, value), self.count_by_state()
            if stored != value and not sum(counts[state] for state in _USED_STATES):
                # What was measured for the other value does not hold any more either.
                for name in attributes:
                    self.storage.rdb.set_study_user_attr(self.study_id, name, None)
                stored = value
            self.storage.rdb.set_study_user_attr(self.study_id, key, dict(stored))
        differences = [
            f"{name} is {stored.get(name)!r} there and {value[name]!r} here"
            for name in value
            if stored.get(name) != value[name]
        ]
        if differences:
            raise InputError(
                f"study {self.name} was started with another {key}: {', '.join(differences)}; "
                "choose another --study"
            )

    def measure_once(self, key: str, measure: Callable[[], float]) -> float:
        """Return the study's attribute `key`, measured by the first caller."""
        with self.storage.lock():
            attributes = self.storage.rdb.get_study_user_attrs(self.study_id)
            value = attributes.get(key)
            if value is None:
                value = measure()
                self.storage.rdb.set_study_user_attr(self.study_id, key, value)
        return float(value)

    def finish(self, claim: ClaimedTrial, values: Sequence[float], attributes: Mapping[str, Any]) -> bool:
        """Complete the trial; false if it was counted as lost: another worker then completes its job."""
        # A transaction each, so before the lock, for which other workers wait.
        if not self._set_attributes(claim.trial_id, attributes):
            return self._has_state(claim.trial_id, TrialState.COMPLETE)
        # Under the lock: SQLite may otherwise complete a trial that another worker has just failed.
        with self.storage.lock():
            return self._end_trial(claim.trial_id, TrialState.COMPLETE, {}, values)

    def fail(self, claim: ClaimedTrial, reason: str, *, counts: bool = True) -> None:
        """Fail the trial for `reason`; `counts` is whether the failure counts against its job."""
        self._fail_trial(claim.trial_id, reason, counts=counts)

    def count_by_state(self) -> dict[TrialState, int]:
        """Count the trials in each state; cheap, unlike reading the trials."""
        return optuna_adapter.count_trials(self.storage.rdb, self.study_id)

    def get_trials(self) -> list[FrozenTrial]:
        """Return all trials, by number."""
        return self.storage.rdb.get_all_trials(self.study_id, deepcopy=False)

    def _fail_stale_trials(self) -> None:
        """Fail the trials whose workers sent no heartbeat, unless the database was offline."""
        policy = self.storage.policy
        if time.monotonic() - self.storage.last_offline_at < policy.grace_s:
            return
        for trial_id in optuna_adapter.stale_trial_ids(self.storage.rdb, self.study_id):
            self._fail_trial(trial_id, LOST.format(policy.grace_s), counts=True)

    def _fail_trial(self, trial_id: int, reason: str, *, counts: bool) -> None:
        self._end_trial(trial_id, TrialState.FAIL, {REASON: reason} | ({} if counts else {COUNTS: False}))

    def _end_trial(
        self,
        trial_id: int,
        state: TrialState,
        attributes: Mapping[str, Any],
        values: Sequence[float] | None = None,
    ) -> bool:
        """End a trial; return whether it is now in `state`. A trial that has already ended stays as it is.

        It has already ended in `state` if the connection broke after it was ended: no other worker completes
        a claimed trial.
        """
        if not self._set_attributes(trial_id, attributes):
            return self._has_state(trial_id, state)
        try:
            self.storage.rdb.set_trial_state_values(trial_id, state, values)
        except UpdateFinishedTrialError:
            return self._has_state(trial_id, state)
        return True

    def _set_attributes(self, trial_id: int, attributes: Mapping[str, Any]) -> bool:
        """Set user attributes of a trial; false if it has ended."""
        try:
            for key, value in attributes.items():
                self.storage.rdb.set_trial_user_attr(trial_id, key, value)
        except UpdateFinishedTrialError:
            return False
        return True

    def _has_state(self, trial_id: int, state: TrialState) -> bool:
        return self.storage.rdb.get_trial(trial_id).state is state
