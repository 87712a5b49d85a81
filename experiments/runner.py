"""Run jobs of the experiments: train what is not trained, measure what is not measured, keep all metrics."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import keras

from experiments import datasets
from experiments.datasets import PhotoSplits
from experiments.experiment_specs import Job, job_config
from experiments.mask_only_estimator import MaskOnlyEstimator
from experiments.paths import MEASURED, MIXTURE, SETTINGS
from laesi_tf.common.atomic_files import read_json, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.easy_leaf_area import EasyLeafArea
from laesi_tf.evaluation.photo_scores import score_photos, summarise
from laesi_tf.models.saved_model import Run, load_run
from laesi_tf.training import run_directory
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.loop import fit
from laesi_tf.training.tasks import make_task

_EVALUATED_SPLITS = ("val", "test")

Metrics = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ExperimentRunner:
    """Experiments in the folder `out`, with data sets in the folder `sets`, at a scale of 0 to 1."""

    out: Path
    sets: Path
    photos: PhotoSplits
    scale: float
    weights: str

    def begin(self) -> None:
        """Note what the experiments are made with. Raises InputError where others have begun in `out`."""
        settings = {"scale": self.scale, "photos": self.photos.counts, "manifest": self.photos.digest}
        path = self.out / SETTINGS
        if not path.is_file():
            write_json(path, settings)
        elif read_json(path) != settings:
            raise InputError(
                f"{self.out} holds experiments on other photos or at another scale; choose another --out"
            )

    def missing(self, trial: Job) -> str | None:
        """Why `trial` cannot be run, or None where it can."""
        if trial.task == "mask" and not self.photos.masked:
            return "no masks in some split of the manifest"
        size = job_config(trial.task, scale=self.scale).size
        return datasets.explain_missing_data(trial, self.sets, size=size, scale=self.scale)

    def run(self, trial: Job) -> Metrics:
        """The figures of `trial` on validation and test photos, as `summarise` gives them.

        What a killed run did is kept: training continues, and what was measured is read. Raises InputError,
        also where the trial was begun with another recipe or other data.
        """
        path = self.out / trial.folder / MEASURED
        by_rules = trial.row.kind == "rule_based"
        if not path.is_file():
            write_json(path, self._by_rules(trial) if by_rules else self._trained(trial))
        elif not by_rules:
            run_directory.check_run_directory(path.parent, self._config(trial))
        return read_json(path)

    def finished(self, trial: Job) -> bool:
        """Whether nothing is left to be done."""
        return (self.out / trial.folder / MEASURED).is_file()

    def _config(self, trial: Job) -> TrainConfig:
        mixture = str((self.out / trial.group / MIXTURE).resolve())
        return job_config(
            trial.task, scale=self.scale, weights=self.weights, seed=trial.seed, mixture=mixture
        )

    def _by_rules(self, trial: Job) -> Metrics:
        scenes = datasets.generate_square_photos(trial, self.sets, scale=self.scale)
        found = summarise(score_photos(EasyLeafArea(), scenes))
        return dict.fromkeys(_EVALUATED_SPLITS, found)

    def _trained(self, trial: Job) -> Metrics:
        settings, splits = self._config(trial), self.photos.splits
        side, task = settings.size[0], make_task(settings)
        datasets.write_mixture(
            Path(settings.mixture), trial, self.photos, self.sets, size=side, scale=self.scale
        )
        judged = datasets.make_validation_batches(
            splits["val"], task=task, size=side, batch_size=settings.batch_size
        )
        result = fit(
            settings, self.out / trial.folder, validation=judged, validation_name="the validation photos"
        )
        estimator = _make_estimator(load_run(result.path))
        found: dict[str, Any] = {
            name: summarise(score_photos(estimator, splits[name])) for name in _EVALUATED_SPLITS
        }
        # Two dozen networks with their graphs would fill the memory.
        keras.utils.clear_session()
        return found | {key: result.metrics[key] for key in ("weights_origin", "minutes")}


def _make_estimator(run: Run) -> Estimator:
    if run.spec.task == "mask":
        return MaskOnlyEstimator(run.model, run.spec.size)
    return AreaEstimator(run.model, run.spec.size, run.spec.transform)
