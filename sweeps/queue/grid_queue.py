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
        return sum(trial.user_attrs.get(COUNTS, True) for trial in self.failed)

    @property
    def needs_trial(self) -> bool:
        """Whether no trial is complete, running or waiting: the job is due for a retry, or was given up."""
        return not (self.complete or self.running or self.waiting)


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

    def enqueue(self, jobs: Iterable[Job]) -> int:
        """Add the `jobs` that the study does not have yet; return how many."""
        with self.storage.lock():
            known = self.job_histories()
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
            claim = self._take_first(self._waiting)
            if claim is None:
                self._waiting = self._next_group()
                claim = self._take_first(self._waiting)
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
        return len(self.job_histories())

    def list_given_up(self) -> dict[str, list[str]]:
        """Return the reasons of each job that failed too often to be retried, by the job's name."""
        return {
            name: [trial.user_attrs.get(REASON, "") for trial in history.failed]
            for name, history in self.job_histories().items()
            if history.needs_trial
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

    def _requeue_missing(self) -> None:
        self._fail_stale_trials()
        for history in self.job_histories().values():
            is_under_way = history.complete or history.running
            # Optuna repeats the creation of a trial whose connection broke, even if it had succeeded.
            for trial in history.waiting[0 if is_under_way else 1 :]:
                self._fail_trial(optuna_adapter.trial_id(trial), "queued twice", counts=False)
            if history.needs_trial and history.failure_count <= self.storage.policy.retries:
                self._queue_job(history.job)

    def _queue_job(self, job: Job) -> None:
        trial = optuna.create_trial(
            state=TrialState.WAITING,
            params=dict(job.levels),
            distributions=dict(self._distributions),
            user_attrs={JOB: job.name, SEED: job.seed},
        )
        self.storage.rdb.create_new_trial(self.study_id, trial)

    def _take_first(self, waiting: list[ClaimedTrial]) -> ClaimedTrial | None:
        """Claim the first of `waiting` that no other worker has; remove it and those before it."""
        while waiting:
            claim = waiting.pop(0)
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
        self._requeue_missing()
        groups: dict[Any, list[ClaimedTrial]] = {}
        busy = set()
        for history in self.job_histories().values():
            group = self._group(history.job)
            if history.running:
                busy.add(group)
            elif history.waiting and not history.complete:
                trial = history.waiting[0]
                reasons = tuple(failed.user_attrs.get(REASON, "") for failed in history.failed)
                claim = ClaimedTrial(optuna_adapter.trial_id(trial), trial.number, history.job, reasons)
                groups.setdefault(group, []).append(claim)
        free = [claims for group, claims in groups.items() if group not in busy]
        chosen = next(itertools.chain(free, sorted(groups.values(), key=len, reverse=True)), [])
        return sorted(chosen, key=lambda claim: claim.job.name)
