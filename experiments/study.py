"""Running trials: train what is not trained yet, measure what is not measured yet, keep every figure."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import keras

from experiments import data
from experiments.data import Photos
from experiments.masks import NetworkMask
from experiments.rows import Trial, config
from laesi_tf import runs
from laesi_tf.config import TrainConfig
from laesi_tf.data.synthetic import Task
from laesi_tf.errors import InputError
from laesi_tf.estimators import Estimator, Regression, RuleBased
from laesi_tf.files import read_json, write_json
from laesi_tf.runs import Run, load_run
from laesi_tf.scoring import evaluate, summarise
from laesi_tf.training import fit

SETTINGS, MEASURED = "settings.json", "photos.json"
"""What a folder of experiments was made with; what a trial's model makes of the photos, which ends it."""
_MIXTURE = "mixture.toml"
_JUDGED = ("val", "test")

Figures = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Study:
    """Experiments in the folder `out`, with data sets in the folder `sets`, at a scale of 0 to 1."""

    out: Path
    sets: Path
    photos: Photos
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

    def missing(self, trial: Trial) -> str | None:
        """Why `trial` cannot be run, or None where it can."""
        if trial.task == "mask" and not self.photos.masked:
            return "no masks in some split of the manifest"
        size = config(trial.task, scale=self.scale).size
        return data.missing(trial, self.sets, size=size, scale=self.scale)

    def run(self, trial: Trial) -> Figures:
        """The figures of `trial` on validation and test photos, as `summarise` gives them.

        What a killed run did is kept: training continues, and what was measured is read. Raises InputError,
        also where the trial was begun with another recipe or other data.
        """
        path = self.out / trial.folder / MEASURED
        by_rules = trial.row.kind == "rule_based"
        if not path.is_file():
            write_json(path, self._by_rules(trial) if by_rules else self._trained(trial))
        elif not by_rules:
            runs.origin_of(path.parent, self._config(trial))
        return read_json(path)

    def finished(self, trial: Trial) -> bool:
        """Whether nothing is left to be done."""
        return (self.out / trial.folder / MEASURED).is_file()

    def _config(self, trial: Trial) -> TrainConfig:
        mixture = str((self.out / trial.group / _MIXTURE).resolve())
        return config(trial.task, scale=self.scale, weights=self.weights, seed=trial.seed, mixture=mixture)

    def _by_rules(self, trial: Trial) -> Figures:
        scenes = data.square_photos(trial, self.sets, scale=self.scale)
        found = summarise(evaluate(RuleBased(), scenes))
        return dict.fromkeys(_JUDGED, found)

    def _trained(self, trial: Trial) -> Figures:
        settings, splits = self._config(trial), self.photos.splits
        side, task = settings.size[0], cast(Task, trial.task)
        data.write_mixture(Path(settings.mixture), trial, self.photos, self.sets, size=side, scale=self.scale)
        judged = data.batches(splits["val"], task=task, size=side, batch_size=settings.batch_size)
        result = fit(
            settings, self.out / trial.folder, validation=judged, validated_on="the validation photos"
        )
        estimator = _estimator(load_run(result.path))
        found: dict[str, Any] = {name: summarise(evaluate(estimator, splits[name])) for name in _JUDGED}
        # Two dozen networks with their graphs would fill the memory.
        keras.utils.clear_session()
        return found | {key: result.metrics[key] for key in ("weights_origin", "minutes")}


def _estimator(run: Run) -> Estimator:
    if run.config.task == "mask":
        return NetworkMask(run.model, run.config.size)
    return Regression(run.model, run.config.size, run.config.transform)
