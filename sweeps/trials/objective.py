"""The Optuna objective: train a point and keep its metrics, images and checkpoint."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from optuna.artifacts import FileSystemArtifactStore, upload_artifact
from optuna.trial import TrialState

from laesi_tf.common import run_files
from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.training import run_directory
from laesi_tf.training.trainer import TrainingDiverged
from sweeps.queue.tpe_queue import PRUNED_AT, TpeQueue
from sweeps.queue.trial_queue import SEED, ClaimedTrial, TrialQueue
from sweeps.trials import artifacts
from sweeps.trials.search_space import Point
from sweeps.trials.trial_runner import TrialOutcome, TrialRunner
from sweeps.workers.watchdog import TrialFailed, TrialWatchdog
from sweeps.workers.worker import TrialResult

DIVERGED = "training diverged"
GUESS = "guess_mre"
"""User attribute of a study: the MRE of one guess for all its validation pictures."""
_SEED_STEP = 1000


class _PruneTrial(Exception):
    """A trial that is pruned, with its error so far."""

    def __init__(self, step: int, mre: float) -> None:
        super().__init__(step, mre)
        self.step, self.mre = step, mre


class TrainingObjective:
    """An objective that trains with `trainer` and keeps artifacts and checkpoints below `folder`."""

    def __init__(self, trainer: TrialRunner, book: TrialQueue, folder: Path) -> None:
        self._trainer, self._book, self._folder = trainer, book, folder
        (folder / "artifacts").mkdir(parents=True, exist_ok=True)
        self._artifacts = FileSystemArtifactStore(folder / "artifacts")
        book.once(GUESS, trainer.pictures.guess_mre)
        complete = (trial for trial in book.trials() if trial.state is TrialState.COMPLETE)
        self._best = min((trial.values[0] for trial in complete), default=np.inf)

    def __call__(self, claim: ClaimedTrial, clock: TrialWatchdog) -> TrialResult:
        """Train the job's point; the values are the MRE and the milliseconds of an inference.

        A job that diverged would diverge again, so each divergence moves it on to another seed.
        """
        point = Point(**claim.job.levels)
        seed = claim.job.seed + _SEED_STEP * sum(DIVERGED in reason for reason in claim.reasons)
        self._trainer.prepare(point, seed)
        kind, _ = self._trainer.key(point)
        patiently, book = self._book.store.patiently, self._book
        inference_ms = patiently(
            lambda: book.once(f"inference_ms {kind}", lambda: self._trainer.inference_ms(point))
        )
        attributes = {SEED: seed, "inference_ms": inference_ms}
        clock.start()
        try:
            outcome = self._trained(claim, point, seed, clock)
        except TrainingDiverged as error:
            raise TrialFailed(str(error)) from error
        except _PruneTrial as end:
            return TrialResult([end.mre, inference_ms], attributes | {PRUNED_AT: end.step})
        patiently(lambda: self._keep_pictures(claim, outcome))
        checkpoint = self._checkpoint(claim, point, seed, outcome)
        return TrialResult(
            [outcome.mre, inference_ms], outcome_attributes(outcome) | attributes | {"checkpoint": checkpoint}
        )

    def _trained(self, claim: ClaimedTrial, point: Point, seed: int, clock: TrialWatchdog) -> TrialOutcome:
        if not isinstance(self._book, TpeQueue):
            return self._trainer.run(point, seed, alive=clock.check)
        search, steps = self._book, self._trainer.budget.steps

        def reached(step: int, mre: float) -> None:
            if search.store.patiently(lambda: search.hopeless(claim, step, mre)):
                raise _PruneTrial(step, mre)

        return self._trainer.run(
            point, seed, alive=clock.check, rungs=(steps // 4, steps // 2), reached=reached
        )

    def _keep_pictures(self, claim: ClaimedTrial, outcome: TrialOutcome) -> None:
        storage = self._book.store.storage
        worst = artifacts.draw_worst_images(outcome.found, self._trainer.pictures.validation)
        with tempfile.TemporaryDirectory() as folder:
            drawn = {"loss.png": artifacts.draw_loss_curve(outcome.losses), "worst.jpg": worst}
            for name, data in drawn.items():
                path = Path(folder) / name
                path.write_bytes(data)
                trial = storage.get_trial(claim.trial_id)
                upload_artifact(
                    artifact_store=self._artifacts, file_path=str(path), study_or_trial=trial, storage=storage
                )

    def _checkpoint(self, claim: ClaimedTrial, point: Point, seed: int, outcome: TrialOutcome) -> str:
        """Keep the network if it is the best this worker knows of; its run folder's name, else nothing.

        1,425 networks would take gigabytes, and any is trained again in seconds.
        """
        if outcome.mre >= self._best:
            return ""
        self._best = outcome.mre
        name = f"{self._book.name}-{claim.job.name.replace('/', '-')}"
        out = self._folder / "checkpoints" / name
        run_directory.create_run_directory(
            out, self._trainer.budget.config(point, seed), self._trainer.origins[point.start]
        )
        with atomic_write(out / run_files.BEST_MODEL_FILE) as temporary:
            self._trainer.model(point).save(temporary)
        return name


def outcome_attributes(outcome: TrialOutcome) -> dict[str, Any]:
    """The user attributes of an outcome."""
    return {
        "median": float(np.median(outcome.found["error"])),
        "p90": float(np.percentile(outcome.found["error"], 90)),
        "final_loss": float(np.mean(outcome.losses[-10:])),
        "validation_loss": float(outcome.found["loss"][0]),
        "images_per_s": outcome.images_per_s,
        "parameters": outcome.parameters,
        "steps_s": outcome.steps_s,
        "steps_cpu_s": outcome.steps_cpu_s,
        "judging_s": outcome.judging_s,
    }
