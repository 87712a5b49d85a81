"""The base class of the queues that workers share: claims, results and counts of a study's trials."""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import optuna
import sqlalchemy
from optuna.exceptions import ExperimentalWarning, UpdateFinishedTrialError
from optuna.trial import FrozenTrial, TrialState

from laesi_tf.common.errors import InputError
from sweeps.queue.study_storage import StudyStorage

OBJECTIVES = ("MRE, %", "inference, ms")
JOB, SEED, REASON, COUNTS = "job", "seed", "reason", "counts"
"""User attributes: a trial's job and seed; why it failed, and whether that counts against its job."""
_USED_STATES = (TrialState.RUNNING, TrialState.COMPLETE, TrialState.PRUNED)
LOST = "worker lost: no sign of life for {} s"


@dataclass(frozen=True)
class Job:
    """A level of every factor, and the seed to try it with."""

    name: str
    levels: Mapping[str, str]
    seed: int


@dataclass(frozen=True)
class ClaimedTrial:
    """A trial that is this worker's alone, and why earlier attempts at its job failed."""

    trial_id: int
    number: int
    job: Job
    reasons: tuple[str, ...] = ()

    @property
    def attempt(self) -> int:
        """Which attempt this is, from 1."""
        return len(self.reasons) + 1


class TrialQueue:
    """The study `name` in a store, made if it is not there: workers ask it what to do and tell how it went.

    What is called by several workers at once does what it must under the lock of the store.
    """

    def __init__(self, store: StudyStorage, name: str, *, objectives: Sequence[str] = OBJECTIVES) -> None:
        self.store, self.name = store, name
        with store.lock(), warnings.catch_warnings():
            warnings.simplefilter("ignore", ExperimentalWarning)
            self.study = optuna.create_study(
                storage=store.storage,
                study_name=name,
                directions=["minimize"] * len(objectives),
                load_if_exists=True,
            )
            self.study.set_metric_names(list(objectives))
        self.study_id = store.storage.get_study_id_from_name(name)

    def claim(self) -> ClaimedTrial | None:
        """The next trial, now this worker's; None if there is none at the moment."""
        raise NotImplementedError

    def finished(self) -> bool:
        """Whether no trial is left to do or under way."""
        raise NotImplementedError

    def agree(self, key: str, value: Mapping[str, Any]) -> None:
        """Keep `value` with the study, or raise InputError if another is kept there and trials went by it."""
        with self.store.lock():
            attributes = self.store.storage.get_study_user_attrs(self.study_id)
            kept, counts = attributes.get(key, value), self.counts()
            if kept != value and not sum(counts[state] for state in _USED_STATES):
                # Nor does what was measured for the other value hold any more.
                for name in attributes:
                    self.store.storage.set_study_user_attr(self.study_id, name, None)
                kept = value
            self.store.storage.set_study_user_attr(self.study_id, key, dict(kept))
        differing = [name for name in value if kept.get(name) != value[name]]
        if differing:
            told = ", ".join(f"{name} {kept.get(name)!r} there, {value[name]!r} here" for name in differing)
            raise InputError(f"study {self.name} was begun with another {key}: {told}; name another --study")

    def once(self, key: str, measure: Callable[[], float]) -> float:
        """What `measure` gave the first time that anyone asked for `key` in this study."""
        with self.store.lock():
            known = self.store.storage.get_study_user_attrs(self.study_id)
            if known.get(key) is None:
                known[key] = measure()
                self.store.storage.set_study_user_attr(self.study_id, key, known[key])
        return known[key]

    def finish(self, claim: ClaimedTrial, values: Sequence[float], attributes: Mapping[str, Any]) -> bool:
        """Complete the trial; false if it was given up for lost meanwhile: then another will complete it."""
        # Under the lock, as SQLite may let a trial that another has just given up be completed after all.
        with self.store.lock():
            return self._end(claim.trial_id, TrialState.COMPLETE, attributes, values)

    def fail(self, claim: ClaimedTrial, reason: str, *, counts: bool = True) -> None:
        """Fail the trial, saying why; `counts` is whether that is held against its job."""
        self._fail(claim.trial_id, reason, counts=counts)

    def counts(self) -> dict[TrialState, int]:
        """How many trials there are in each state; cheap, unlike reading the trials."""
        query = "SELECT state, COUNT(*) FROM trials WHERE study_id = :study GROUP BY state"
        with self.store.storage.engine.connect() as connection:
            rows = connection.execute(sqlalchemy.text(query), {"study": self.study_id})
            found = {TrialState[state]: int(count) for state, count in rows}
        return {state: found.get(state, 0) for state in TrialState}

    def trials(self) -> list[FrozenTrial]:
        """All trials, by number."""
        return self.store.storage.get_all_trials(self.study_id, deepcopy=False)

    def _fail_lost(self) -> None:
        """Fail the trials whose workers have not been heard of; while the database was away no one was."""
        if time.monotonic() - self.store.away_at < self.store.rules.grace_s:
            return
        for trial_id in self.store.storage._get_stale_trial_ids(self.study_id):
            self._fail(trial_id, LOST.format(self.store.rules.grace_s), counts=True)

    def _fail(self, trial_id: int, reason: str, *, counts: bool) -> None:
        self._end(trial_id, TrialState.FAIL, {REASON: reason} | ({} if counts else {COUNTS: False}))

    def _end(
        self,
        trial_id: int,
        state: TrialState,
        attributes: Mapping[str, Any],
        values: Sequence[float] | None = None,
    ) -> bool:
        """End a trial; if it has ended already it stays as it is, and the answer is whether in this state.

        It is in this state if it was ended before a connection broke: no one else completes a claimed trial.
        """
        storage = self.store.storage
        try:
            for key, value in attributes.items():
                storage.set_trial_user_attr(trial_id, key, value)
            storage.set_trial_state_values(trial_id, state, values)
        except UpdateFinishedTrialError:
            return storage.get_trial(trial_id).state is state
        return True
