"""The queue of a grid: which jobs there are, who runs which, how each ended.

A job is a point of the grid with a seed; a trial is one attempt at it. Optuna's own means lose or repeat
jobs: its GridSampler gives two workers the same point and never retries a failed one, and its callback that
requeues the trials of dead workers loses the job if it is killed between failing one trial and queueing the
next. Here nothing depends on an unfinished action: `requeue_missing` reads the state of every job and queues
what is missing, under the storage's lock, with the same result whoever calls it, and how often. A job has at
most one trial that is waiting or running, and none once one is complete; so each job completes exactly once.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.exceptions import UpdateFinishedTrialError
from optuna.trial import FrozenTrial, TrialState

from laesi_tf.common.progress import progress_bar
from sweeps.queue import optuna_adapter
from sweeps.queue.optuna_adapter import TrialSummary
from sweeps.queue.study_storage import StudyStorage
from sweeps.queue.trial_queue import COUNTS, JOB, REASON, SEED, ClaimedTrial, Job, TrialQueue


@dataclass
class JobHistory:
    """The trials of a job by state."""

    job: Job
    complete: FrozenTrial | None = None
    running: list[FrozenTrial] = field(default_factory=list)
    waiting: list[FrozenTrial] = field(default_factory=list)
    failed: list[FrozenTrial] = field(default_factory=list)

    @property
    def failure_count(self) -> int:
        """Failures that count against the job; a user who stops the worker does not."""
        return _count_failures(self.failed)


@dataclass
class _JobState:
    """The trials of a job by state, without what only readers of results need."""

    is_complete: bool = False
    is_running: bool = False
    waiting: list[TrialSummary] = field(default_factory=list)
    failed: list[TrialSummary] = field(default_factory=list)

    @property
    def is_due(self) -> bool:
        """Whether no trial is complete, running or waiting: the job is due for a retry, or was given up."""
        return not (self.is_complete or self.is_running or self.waiting)


def _count_failures(failed: Iterable[FrozenTrial | TrialSummary]) -> int:
    return sum(trial.user_attrs.get(COUNTS, True) for trial in failed)


class GridQueue(TrialQueue):
    """The queue of the study `name` whose jobs have `factors`; jobs of one `group` share compiled code."""

    def __init__(
        self,
        storage: StudyStorage,
        name: str,
        factors: Mapping[str, Sequence[str]],
        *,
        group: Callable[[Job], Any] = lambda job: None,
    ) -> None:
        super().__init__(storage, name)
        self._group = group
        self._distributions: dict[str, BaseDistribution] = {
            factor: CategoricalDistribution(levels) for factor, levels in factors.items()
        }
        self._waiting: list[ClaimedTrial] = []
        self._jobs: dict[str, Job] = {}

    def enqueue(self, jobs: Iterable[Job]) -> int:
        """Add the `jobs` that the study does not have yet; return how many."""
        with self.storage.lock():
            known = self._read_states()
            missing = [job for job in jobs if job.name not in known]
            for job in progress_bar(missing, desc="queueing", unit="job"):
                self._queue_job(job)
        return len(missing)

    def requeue_missing(self) -> None:
        """Fail the trials of lost workers; queue each job that is not complete, running or waiting."""
        with self.storage.lock():
            self._requeue_missing()

    def claim(self) -> ClaimedTrial | None:
        """Claim the next trial for this worker; None if none is waiting.

        Trials of the previous one's group come first, then those of a group that no other worker is at.
        """
        with self.storage.lock():
            claim = self._take_first()
            if claim is None:
                self._waiting = self._next_group()
                claim = self._take_first()
        return claim

    def fail(self, claim: ClaimedTrial, reason: str, *, counts: bool = True) -> None:
        """Fail the trial and queue its job again, unless the policy's retries are used up."""
        with self.storage.lock():
            super().fail(claim, reason, counts=counts)
            self._requeue_missing()

    def is_finished(self) -> bool:
        """Return whether no trial is waiting or running."""
        counts = self.count_by_state()
        return not counts[TrialState.WAITING] + counts[TrialState.RUNNING]

    def expected_total(self) -> int:
        """Return how many jobs the study has."""
        return len(self._read_states())

    def list_given_up(self) -> dict[str, list[str]]:
        """Return the reasons of each job that failed too often to be retried, by the job's name."""
        return {
            name: [trial.user_attrs.get(REASON, "") for trial in state.failed]
            for name, state in self._read_states().items()
            if state.is_due
        }

    def job_histories(self) -> dict[str, JobHistory]:
        """Return the trials of each job, by the job's name."""
        histories: dict[str, JobHistory] = {}
        for trial in self.get_trials():
            name = trial.user_attrs[JOB]
            job = Job(name, trial.params, trial.user_attrs[SEED])
            history = histories.setdefault(name, JobHistory(job))
            if trial.state is TrialState.COMPLETE:
                history.complete = trial
            else:
                by_state = {TrialState.RUNNING: history.running, TrialState.WAITING: history.waiting}
                by_state.get(trial.state, history.failed).append(trial)
        return histories

    def _requeue_missing(self) -> dict[str, _JobState]:
        """Do what `requeue_missing` does; return the states of the jobs from which it was done."""
        self._fail_stale_trials()
        states = self._read_states()
        if states.keys() - self._jobs.keys():
            self._read_jobs()
        has_changed = False
        for name, state in states.items():
            is_under_way = state.is_complete or state.is_running
            # Optuna repeats the creation of a trial whose connection broke, even if it had succeeded.
            for trial in state.waiting[0 if is_under_way else 1 :]:
                self._fail_trial(trial.trial_id, "queued twice", counts=False)
            if state.is_due and _count_failures(state.failed) <= self.storage.policy.retries:
                self._queue_job(self._jobs[name])
                has_changed = True
        return self._read_states() if has_changed else states

    def _read_states(self) -> dict[str, _JobState]:
        """Return the states of all jobs, by name."""
        states: dict[str, _JobState] = {}
        for trial in optuna_adapter.summarise_trials(self.storage.rdb, self.study_id, (JOB, REASON, COUNTS)):
            state = states.setdefault(trial.user_attrs[JOB], _JobState())
            if trial.state is TrialState.COMPLETE:
                state.is_complete = True
            elif trial.state is TrialState.RUNNING:
                state.is_running = True
            elif trial.state is TrialState.WAITING:
                state.waiting.append(trial)
            else:
                state.failed.append(trial)
        return states

    def _read_jobs(self) -> None:
        """Read the levels and seeds of all jobs, which never change."""
        rdb, study = self.storage.rdb, self.study_id
        parameters = optuna_adapter.read_parameters(rdb, study)
        for trial in optuna_adapter.summarise_trials(rdb, study, (JOB, SEED)):
            name = trial.user_attrs[JOB]
            if name not in self._jobs:
                positions = parameters[trial.trial_id]
                levels = {f: d.to_external_repr(positions[f]) for f, d in self._distributions.items()}
                self._jobs[name] = Job(name, levels, trial.user_attrs[SEED])

    def _queue_job(self, job: Job) -> None:
        trial = optuna.create_trial(
            state=TrialState.WAITING,
            params=dict(job.levels),
            distributions=dict(self._distributions),
            user_attrs={JOB: job.name, SEED: job.seed},
        )
        self.storage.rdb.create_new_trial(self.study_id, trial)

    def _take_first(self) -> ClaimedTrial | None:
        """Claim the first trial of this worker's group that no other worker has claimed."""
        if self._waiting:
            free = optuna_adapter.waiting_trial_ids(self.storage.rdb, self.study_id)
            self._waiting = [claim for claim in self._waiting if claim.trial_id in free]
        while self._waiting:
            claim = self._waiting.pop(0)
            if self._take(claim.trial_id):
                return claim
        return None

    def _take(self, trial_id: int) -> bool:
        """Set a waiting trial to running; false if another worker has.

        The first heartbeat comes before: a worker that is killed right after the claim must not leave a
        running trial without one, which Optuna would count as alive for ever.
        """
        try:
            optuna_adapter.send_heartbeat(self.storage.rdb, trial_id)
            return self.storage.rdb.set_trial_state_values(trial_id, TrialState.RUNNING)
        except UpdateFinishedTrialError:
            return False

    def _next_group(self) -> list[ClaimedTrial]:
        """Return the waiting trials of one group, in the order of their jobs."""
        groups: dict[Any, list[ClaimedTrial]] = {}
        busy = set()
        for name, state in self._requeue_missing().items():
            job = self._jobs[name]
            group = self._group(job)
            if state.is_running:
                busy.add(group)
            elif state.waiting and not state.is_complete:
                trial = state.waiting[0]
                reasons = tuple(failed.user_attrs.get(REASON, "") for failed in state.failed)
                claim = ClaimedTrial(trial.trial_id, trial.number, job, reasons)
                groups.setdefault(group, []).append(claim)
        free = [claims for group, claims in groups.items() if group not in busy]
        chosen = next(itertools.chain(free, sorted(groups.values(), key=len, reverse=True)), [])
        return sorted(chosen, key=lambda claim: claim.job.name)
