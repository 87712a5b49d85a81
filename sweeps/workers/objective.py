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
from sweeps.queue.tpe_queue import PRUNED_AT
from sweeps.queue.trial_queue import SEED, ClaimedTrial, TrialQueue
from sweeps.trials import artifacts
from sweeps.trials.search_space import Point
from sweeps.trials.trial_runner import TrialOutcome, TrialRunner
from sweeps.workers.watchdog import TrialFailed, TrialWatchdog
from sweeps.workers.worker import TrialResult

DIVERGED = "training diverged"
GUESS = "guess_mre"
"""User attribute of a study: the MRE of a constant guess on its validation images."""
_SEED_STEP = 1000
"""Added to the seed after each divergence."""


class _PruneTrial(Exception):
    """The trial is pruned after `step` steps with the error `mre`."""

    def __init__(self, step: int, mre: float) -> None:
        super().__init__(step, mre)
        self.step, self.mre = step, mre


class TrainingObjective:
    """An objective that trains with `runner` and keeps artifacts and checkpoints below `folder`."""

    def __init__(self, runner: TrialRunner, queue: TrialQueue, folder: Path) -> None:
        self._runner, self._queue, self._folder = runner, queue, folder
        (folder / "artifacts").mkdir(parents=True, exist_ok=True)
        self._artifacts = FileSystemArtifactStore(folder / "artifacts")
        queue.measure_once(GUESS, runner.data.constant_guess_mre)
        complete = (trial for trial in queue.get_trials() if trial.state is TrialState.COMPLETE)
        self._best = min((trial.values[0] for trial in complete), default=np.inf)

    def __call__(self, claim: ClaimedTrial, watchdog: TrialWatchdog) -> TrialResult:
        """Train the job's point; the values are its MRE in percent and the milliseconds of an inference.

        A job that diverged would diverge again with the same seed, so each divergence changes the seed.
        Raises TrialFailed when the training diverges or takes too long.
        """
        point = Point(**claim.job.levels)
        seed = claim.job.seed + _SEED_STEP * sum(DIVERGED in reason for reason in claim.reasons)
        self._runner.prepare(point, seed)
        inference_ms = self._measure_inference(point)
        attributes = {SEED: seed, "inference_ms": inference_ms}
        watchdog.start_clock()
        try:
            outcome = self._train(claim, point, seed, watchdog)
        except TrainingDiverged as error:
            raise TrialFailed(str(error)) from error
        except _PruneTrial as pruned:
            return TrialResult([pruned.mre, inference_ms], attributes | {PRUNED_AT: pruned.step})
        self._queue.storage.retry_while_offline(lambda: self._upload_artifacts(claim, outcome))
        checkpoint = self._save_if_best(claim, point, seed, outcome)
        attributes |= outcome_attributes(outcome) | {"checkpoint": checkpoint}
        return TrialResult([outcome.mre, inference_ms], attributes)

    def _measure_inference(self, point: Point) -> float:
        backbone, _ = self._runner.network_key(point)
        return self._queue.storage.retry_while_offline(
            lambda: self._queue.measure_once(
                f"inference_ms {backbone}", lambda: self._runner.measure_inference_ms(point)
            )
        )

    def _train(self, claim: ClaimedTrial, point: Point, seed: int, watchdog: TrialWatchdog) -> TrialOutcome:
        queue, steps = self._queue, self._runner.budget.steps

        def prune_if_poor(step: int, mre: float) -> None:
            if queue.storage.retry_while_offline(lambda: queue.should_prune(claim, step, mre)):
                raise _PruneTrial(step, mre)

        return self._runner.run(
            point,
            seed,
            check_timeout=watchdog.check_timeout,
            report_steps=(steps // 4, steps // 2) if queue.can_prune else (),
            on_report=prune_if_poor,
        )

    def _upload_artifacts(self, claim: ClaimedTrial, outcome: TrialOutcome) -> None:
        rdb = self._queue.storage.rdb
        files = {
            "loss.png": artifacts.draw_loss_curve(outcome.losses),
            "worst.jpg": artifacts.draw_worst_images(outcome.results, self._runner.data.validation),
        }
        with tempfile.TemporaryDirectory() as folder:
            for name, data in files.items():
                path = Path(folder) / name
                path.write_bytes(data)
                upload_artifact(
                    artifact_store=self._artifacts,
                    file_path=str(path),
                    study_or_trial=rdb.get_trial(claim.trial_id),
                    storage=rdb,
                )

    def _save_if_best(self, claim: ClaimedTrial, point: Point, seed: int, outcome: TrialOutcome) -> str:
        """Save the network if it is the best that this worker knows; return its run folder's name, else "".

        1,425 networks would take gigabytes, and any of them is trained again in seconds.
        """
        if outcome.mre >= self._best:
            return ""
        self._best = outcome.mre
        name = f"{self._queue.name}-{claim.job.name.replace('/', '-')}"
        folder = self._folder / "checkpoints" / name
        config = self._runner.budget.config(point, seed)
        run_directory.create_run_directory(folder, config, self._runner.weight_origins[point.start])
        with atomic_write(folder / run_files.BEST_MODEL_FILE) as temporary:
            self._runner.network(point).save(temporary)
        return name


def outcome_attributes(outcome: TrialOutcome) -> dict[str, Any]:
    """Return the user attributes of an outcome."""
    return {
        "median": float(np.median(outcome.results["error"])),
        "p90": float(np.percentile(outcome.results["error"], 90)),
        "final_loss": float(np.mean(outcome.losses[-10:])),
        "validation_loss": float(outcome.results["loss"][0]),
        "images_per_s": outcome.images_per_s,
        "parameters": outcome.parameters,
        "steps_s": outcome.steps_s,
        "steps_cpu_s": outcome.steps_cpu_s,
        "judging_s": outcome.evaluation_s,
    }
