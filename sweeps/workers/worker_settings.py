"""What a worker process needs to open its study and to train."""

import time
from dataclasses import dataclass
from pathlib import Path

from laesi_tf.common.errors import InputError
from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.tpe_queue import TpeQueue
from sweeps.queue.trial_queue import Job, TrialQueue
from sweeps.trials.budget import Budget
from sweeps.trials.search_space import FACTORS, Point

_RETRY_PAUSE_S = 2.0


@dataclass(frozen=True)
class WorkerSettings:
    """The same for all workers of a command; `trials` is the number of trials of a search, 0 for a grid."""

    storage: str
    study: str
    budget: Budget
    policy: RetryPolicy
    folder: Path
    threads: int
    trials: int = 0

    def open_queue(self) -> TrialQueue:
        """Open the study's queue, which is created if it is missing. Raises InputError."""
        return self.open_search() if self.trials else self.open_grid()

    def open_queue_patiently(self) -> TrialQueue:
        """Open the study's queue for a worker; retry on errors.

        The command has opened it, so the database must be offline. Raises InputError if it stays so.
        """
        started = time.monotonic()
        while True:
            try:
                return self.open_queue()
            except InputError:
                if time.monotonic() - started > self.policy.patience_s:
                    raise
                time.sleep(_RETRY_PAUSE_S)

    def open_grid(self) -> GridQueue:
        """Open the queue of a grid, whose jobs are grouped by the compiled step that they share."""
        return GridQueue(self._open_storage(), self.study, FACTORS, group=self._group)

    def open_search(self) -> TpeQueue:
        """Open the queue of a search."""
        return TpeQueue(
            self._open_storage(),
            self.study,
            FACTORS,
            trials=self.trials,
            seed=job_selection.SCREENING_SEED,
        )

    def _open_storage(self) -> StudyStorage:
        return StudyStorage(self.storage, self.policy)

    def _group(self, job: Job) -> tuple[str, str]:
        return self.budget.config(Point(**job.levels), job.seed).backbone, job.levels["optimizer"]
