"""What a worker process needs to open its study and to train."""

from dataclasses import dataclass
from pathlib import Path

from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.tpe_queue import TpeQueue
from sweeps.queue.trial_queue import Job, TrialQueue
from sweeps.trials.budget import Budget
from sweeps.trials.search_space import FACTORS, Point


def backbone_of_job(job: Job, budget: Budget) -> str:
    """The kind of network that a job trains."""
    return budget.config(Point(**job.levels), job.seed).backbone


@dataclass(frozen=True)
class WorkerSettings:
    """The same for all workers of a command. `trials` is how many a search makes, 0 for a grid."""

    storage: str
    study: str
    budget: Budget
    rules: RetryPolicy
    folder: Path
    threads: int
    trials: int = 0

    def open(self) -> TrialQueue:
        """The study's book: a search, or a ledger whose jobs are grouped by the compiled step they share."""
        store = StudyStorage(self.storage, self.rules)
        if self.trials:
            return TpeQueue(store, self.study, FACTORS, trials=self.trials, seed=job_selection.SCREENING_SEED)
        return GridQueue(store, self.study, FACTORS, group=self._group)

    def _group(self, job: Job) -> str:
        return f"{backbone_of_job(job, self.budget)} {job.levels['optimizer']}"
