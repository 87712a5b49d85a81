"""Every way to measure a photo, behind one protocol; only `load_estimator` knows them all."""

from pathlib import Path

from laesi_tf.errors import InputError
from laesi_tf.estimators.base import Estimator, Known, Leaf, Measurement
from laesi_tf.estimators.reading import Reading
from laesi_tf.estimators.regression import Regression
from laesi_tf.estimators.rule_based import NAME, RuleBased
from laesi_tf.estimators.segmentation import Segmentation
from laesi_tf.runs import PRETRAINED, load_run

__all__ = [
    "Estimator",
    "Known",
    "Leaf",
    "Measurement",
    "Reading",
    "Regression",
    "RuleBased",
    "Segmentation",
    "load_estimator",
]


def load_estimator(run: Path | str | None = None, *, mask_run: Path | str | None = None) -> Estimator:
    """Return the estimator that the training run in folder `run` is for; without one, of the shipped runs.

    `rule_based` in place of a run gives Easy Leaf Area, which takes the scale from a red square. A run of
    task `area` gives the regression. With `mask_run`, a run of task `mask`, beside it the ruling of the paper
    is read and the regression stands in where it cannot be. A run of task `mask` alone gives the
    segmentation, which needs a given scale. Raises InputError.
    """
    if str(run) == NAME:
        if mask_run is not None:
            raise InputError(f"{NAME} finds the leaves itself; leave out the mask model {mask_run}")
        return RuleBased()
    if run is None:
        run, mask_run = PRETRAINED / "area", mask_run or PRETRAINED / "mask"
    trained = load_run(Path(run))
    if trained.config.task == "mask":
        if mask_run is not None:
            raise InputError(
                f"{run} is a mask model itself; name an area model beside the mask model {mask_run}"
            )
        return Segmentation(trained.model, trained.config.size)
    regression = Regression(trained.model, trained.config.size, trained.config.transform)
    return regression if mask_run is None else Reading(_segmentation(mask_run), regression)


def _segmentation(run: Path | str) -> Segmentation:
    trained = load_run(Path(run))
    if trained.config.task != "mask":
        raise InputError(f"{run} is a model of {trained.config.task}; name one trained with --task mask")
    return Segmentation(trained.model, trained.config.size)
