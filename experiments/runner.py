"""Run jobs of the experiments: train what is not trained, measure what is not measured, keep all metrics."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import keras

from experiments import datasets
from experiments.datasets import PhotoSplits
from experiments.experiment_specs import Job, job_config
from experiments.paths import MEASURED, MIXTURE, SETTINGS
from laesi_tf.common.atomic_files import read_json, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.easy_leaf_area import EasyLeafArea
from laesi_tf.estimators.keras_networks import MaskOnlyEstimator, make_area_estimator
from laesi_tf.evaluation.photo_scores import score_photos, summarise
from laesi_tf.models.saved_model import Run, load_run
from laesi_tf.training import run_directory
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.loop import fit
from laesi_tf.training.tasks import make_task

_EVALUATED_SPLITS = ("val", "test")
_ESTIMATORS: Mapping[str, Callable[[Run], Estimator]] = {
    "area": lambda run: make_area_estimator(run.model, run.spec.size, run.spec.transform),
    "mask": lambda run: MaskOnlyEstimator(run.model, run.spec.size),
}

Metrics = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ExperimentRunner:
    """Experiments in the folder `out`, with data sets in the folder `data`, at a scale of 0 to 1."""

    out: Path
    data: Path
    photos: PhotoSplits
    scale: float
    weights: str

    def save_settings(self) -> None:
        """Save the settings. Raises InputError if `out` has experiments with other settings."""
        settings = {"scale": self.scale, "photos": self.photos.counts, "manifest": self.photos.digest}
        path = self.out / SETTINGS
        if not path.is_file():
            write_json(path, settings)
        elif read_json(path) != settings:
            raise InputError(
                f"{self.out} holds experiments on other photos or at another scale; choose another --out"
            )

    def explain_missing(self, job: Job) -> str | None:
        """Return why `job` cannot be run; None if it can."""
        if job.task == "mask" and not self.photos.has_masks:
            return "no masks in some split of the manifest"
        size = job_config(job.task, scale=self.scale).size
        return datasets.explain_missing_data(job, self.data, size=size, scale=self.scale)

    def is_finished(self, job: Job) -> bool:
        """Return whether the job's metrics are there."""
        return (self.out / job.folder / MEASURED).is_file()

    def run(self, job: Job) -> Metrics:
        """Return the metrics of `job` on validation and test photos, as `summarise` gives them.

        An interrupted training is continued, existing metrics are read. Raises InputError, also if the job
        was started with another recipe or other data, and TrainingDiverged.
        """
        path = self.out / job.folder / MEASURED
        uses_rules = job.experiment.data_type == "rule_based"
        if not path.is_file():
            write_json(path, self._measure_by_rules(job) if uses_rules else self._train_and_measure(job))
        elif not uses_rules:
            run_directory.check_run_directory(path.parent, self._config(job))
        return cast(Metrics, read_json(path))

    def _config(self, job: Job) -> TrainConfig:
        mixture = str((self.out / job.group / MIXTURE).resolve())
        return job_config(job.task, scale=self.scale, weights=self.weights, seed=job.seed, mixture=mixture)

    def _measure_by_rules(self, job: Job) -> Metrics:
        scenes = datasets.generate_square_photos(job, self.data, scale=self.scale)
        return dict.fromkeys(_EVALUATED_SPLITS, summarise(score_photos(EasyLeafArea(), scenes)))

    def _train_and_measure(self, job: Job) -> Metrics:
        config, splits = self._config(job), self.photos.splits
        side = config.size[0]
        datasets.write_mixture(Path(config.mixture), job, self.photos, self.data, size=side, scale=self.scale)
        validation = datasets.make_validation_batches(
            splits["val"], task=make_task(config), size=side, batch_size=config.batch_size
        )
        result = fit(
            config, self.out / job.folder, validation=validation, validation_name="the validation photos"
        )
        estimator = _ESTIMATORS[job.task](load_run(result.path))
        metrics: dict[str, Any] = {
            name: summarise(score_photos(estimator, splits[name])) for name in _EVALUATED_SPLITS
        }
        # Two dozen networks with their graphs would fill the memory.
        keras.utils.clear_session()
        return metrics | {key: result.metrics[key] for key in ("weights_origin", "minutes")}
