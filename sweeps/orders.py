"""What a worker is told, and how it opens the study it is to work at."""

from dataclasses import dataclass
from pathlib import Path

from sweeps import jobs
from sweeps.book import Book, Job
from sweeps.budget import Budget
from sweeps.grid import FACTORS
from sweeps.ledger import Ledger
from sweeps.search import Search
from sweeps.store import Rules, Store

STORAGE = "runs/sweep/study.db"
"""Where a sweep is kept unless it is told otherwise."""


def beside(storage: str) -> Path:
    """The folder of artifacts and checkpoints that goes with a storage: where its file is."""
    return Path(STORAGE if "://" in storage else storage).parent


@dataclass(frozen=True)
class Orders:
    """The same for all workers of a command. `trials` is how many a search makes, 0 for a grid."""

    storage: str
    study: str
    budget: Budget
    rules: Rules
    folder: Path
    threads: int
    trials: int = 0

    def open(self) -> Book:
        """The study's book: a search, or a ledger whose jobs are grouped by the compiled step they share."""
        store = Store(self.storage, self.rules)
        if self.trials:
            return Search(store, self.study, FACTORS, trials=self.trials, seed=jobs.SCREENING_SEED)
        return Ledger(store, self.study, FACTORS, group=self._group)

    def _group(self, job: Job) -> str:
        return f"{jobs.backbone(job, self.budget)} {job.levels['optimizer']}"
