"""The book of a study: which jobs there are, who does which, how each ended.

A job is a row of the grid with a seed; a trial is one attempt at it. Optuna's own ways lose or double jobs:
its GridSampler gives two workers the same point and never tries a failed one again, and what re-queues the
trials of dead workers can itself be killed between failing a trial and queueing the next, which loses the
job. Here nothing hangs on what anyone was about to do: `settle` reads how each job stands and queues what
is missing, under the lock of the storage, so that it is the same whoever does it, and how often. A job has
at most one trial that is waiting or running, and none once one is complete; so it is completed once.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import optuna
from optuna.distributions import CategoricalDistribution
from optuna.exceptions import UpdateFinishedTrialError
from optuna.trial import FrozenTrial, TrialState
from tqdm import tqdm

from sweeps.queue.study_storage import StudyStorage
from sweeps.queue.trial_queue import COUNTS, JOB, REASON, SEED, ClaimedTrial, Job, TrialQueue


@dataclass
class JobHistory:
    """How a job stands."""

    job: Job
    complete: FrozenTrial | None = None
    running: list[FrozenTrial] = field(default_factory=list)
    waiting: list[FrozenTrial] = field(default_factory=list)
    failed: list[FrozenTrial] = field(default_factory=list)

    @property
    def held_against(self) -> int:
        """Failures that count; that a user stopped the work does not."""
        return sum(trial.user_attrs.get(COUNTS, True) for trial in self.failed)


class GridQueue(TrialQueue):
    """The book of the study `name` of jobs with `factors`; `group` names what a job shares with others."""

    def __init__(
        self,
        store: StudyStorage,
        name: str,
        factors: Mapping[str, Sequence[str]],
        *,
        group: Callable[[Job], Any] = lambda job: None,
    ) -> None:
        super().__init__(store, name)
        self._group = group
        self._distributions = {name: CategoricalDistribution(levels) for name, levels in factors.items()}
        self._waiting: list[ClaimedTrial] = []

    def fill(self, jobs: Iterable[Job]) -> int:
        """Write down the `jobs` that the study has not got yet; how many."""
        with self.store.lock():
            known = self.standings()
            missing = [job for job in jobs if job.name not in known]
            for job in tqdm(missing, delay=2, desc="queueing", unit="job", dynamic_ncols=True):
                self._queue(job)
        return len(missing)

    def settle(self) -> None:
        """Fail the trials of lost workers; queue each job that is not through and has nothing under way."""
        with self.store.lock():
            self._settle()

    def claim(self) -> ClaimedTrial | None:
        """The next trial, now this worker's; None if none is waiting.

        Trials of the last one's group come first. Then comes a group that no one else is at, if there is one.
        """
        with self.store.lock():
            for waiting in (self._waiting, self._next_group):
                self._waiting = waiting() if callable(waiting) else waiting
                while self._waiting:
                    claim = self._waiting.pop(0)
                    if self._take(claim.trial_id):
                        return claim
        return None

    def fail(self, claim: ClaimedTrial, reason: str, *, counts: bool = True) -> None:
        """Fail the trial and queue its job again, unless it has failed as often as the rules allow."""
        with self.store.lock():
            super().fail(claim, reason, counts=counts)
            self._settle()

    def finished(self) -> bool:
        """Whether no trial is waiting or under way."""
        counts = self.counts()
        return not counts[TrialState.WAITING] + counts[TrialState.RUNNING]

    def standings(self) -> dict[str, JobHistory]:
        """How each job stands, by its name."""
        found: dict[str, JobHistory] = {}
        for trial in self.trials():
            name = trial.user_attrs[JOB]
            job = Job(name, trial.params, trial.user_attrs[SEED])
            standing = found.setdefault(name, JobHistory(job))
            if trial.state is TrialState.COMPLETE:
                standing.complete = trial
            else:
                of_state = {TrialState.RUNNING: standing.running, TrialState.WAITING: standing.waiting}
                of_state.get(trial.state, standing.failed).append(trial)
        return found

    def _settle(self) -> None:
        self._fail_lost()
        for standing in self.standings().values():
            under_way = standing.complete or standing.running
            # Optuna repeats a creation whose connection broke, though it may have been done.
            for trial in standing.waiting[0 if under_way else 1 :]:
                self._fail(trial._trial_id, "queued twice", counts=False)
            over = under_way or standing.waiting
            if not over and standing.held_against <= self.store.rules.retries:
                self._queue(standing.job)

    def _queue(self, job: Job) -> None:
        trial = optuna.create_trial(
            state=TrialState.WAITING,
            params=dict(job.levels),
            distributions=dict(self._distributions),
            user_attrs={JOB: job.name, SEED: job.seed},
        )
        self.store.storage.create_new_trial(self.study_id, trial)

    def _take(self, trial_id: int) -> bool:
        """Claim a waiting trial; false if someone else has.

        Its first heartbeat comes before: a worker that is killed right after the claim must not leave a
        running trial without one, which Optuna would take for alive for ever.
        """
        try:
            self.store.storage.record_heartbeat(trial_id)
            return self.store.storage.set_trial_state_values(trial_id, TrialState.RUNNING)
        except UpdateFinishedTrialError:
            return False

    def _next_group(self) -> list[ClaimedTrial]:
        """What there is to claim in one group, in the order of its jobs."""
        self._settle()
        groups: dict[Any, list[ClaimedTrial]] = {}
        busy = set()
        for standing in self.standings().values():
            group = self._group(standing.job)
            if standing.running:
                busy.add(group)
            elif standing.waiting and not standing.complete:
                trial = standing.waiting[0]
                reasons = tuple(failed.user_attrs.get(REASON, "") for failed in standing.failed)
                claim = ClaimedTrial(trial._trial_id, trial.number, standing.job, reasons)
                groups.setdefault(group, []).append(claim)
        free = [claims for group, claims in groups.items() if group not in busy]
        chosen = next(itertools.chain(free, sorted(groups.values(), key=len, reverse=True)), [])
        return sorted(chosen, key=lambda claim: claim.job.name)
