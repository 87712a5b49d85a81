"""Load the estimator that a training run, a pair of runs or the name of a rule-based method stands for."""

from pathlib import Path

from laesi_tf.common.errors import InputError
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.easy_leaf_area import NAME, EasyLeafArea
from laesi_tf.estimators.mask_estimator import MaskEstimator
from laesi_tf.estimators.ruling_estimator import RulingEstimator
from laesi_tf.models.saved_model import PRETRAINED, load_run


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
        return EasyLeafArea()
    if run is None:
        run, mask_run = PRETRAINED / "area", mask_run or PRETRAINED / "mask"
    trained = load_run(Path(run))
    if trained.spec.task == "mask":
        if mask_run is not None:
            raise InputError(
                f"{run} is a mask model itself; name an area model beside the mask model {mask_run}"
            )
        return MaskEstimator(trained.model, trained.spec.size)
    regression = AreaEstimator(trained.model, trained.spec.size, trained.spec.transform)
    return regression if mask_run is None else RulingEstimator(_load_mask_estimator(mask_run), regression)


def _load_mask_estimator(run: Path | str) -> MaskEstimator:
    trained = load_run(Path(run))
    if trained.spec.task != "mask":
        raise InputError(f"{run} is a model of {trained.spec.task}; name one trained with --task mask")
    return MaskEstimator(trained.model, trained.spec.size)
