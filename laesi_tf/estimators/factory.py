"""Load the estimator that a training run, a pair of runs or the name of a method stands for.

Every estimator is registered here, in `_BY_TASK` or `_WITHOUT_RUN`.
"""

from collections.abc import Callable
from pathlib import Path

from laesi_tf.common.errors import InputError
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.easy_leaf_area import EasyLeafArea
from laesi_tf.estimators.mask_estimator import MaskEstimator
from laesi_tf.estimators.ruling_estimator import RulingEstimator
from laesi_tf.models.saved_model import PRETRAINED, Run, load_run


def _make_area_estimator(run: Run) -> AreaEstimator:
    return AreaEstimator(run.model, run.spec.size, run.spec.transform)


def _make_mask_estimator(run: Run) -> MaskEstimator:
    return MaskEstimator(run.model, run.spec.size)


_BY_TASK: dict[str, Callable[[Run], Estimator]] = {
    "area": _make_area_estimator,
    "mask": _make_mask_estimator,
}
"""The estimator that a run of each task is alone."""

_WITHOUT_RUN: dict[str, Callable[[], Estimator]] = {"rule_based": EasyLeafArea}
"""Estimators without a network, by the name that stands in place of a run."""


def load_estimator(run: Path | str | None = None, *, mask_run: Path | str | None = None) -> Estimator:
    """Load the estimator for the training run in folder `run`; without one, for the shipped runs.

    A name of `_WITHOUT_RUN` in place of a run gives that estimator: `rule_based` is Easy Leaf Area, which
    takes the scale from a red square. A run of task `area` gives the area estimator; with `mask_run`, a run
    of task `mask`, beside it, the ruling estimator. A run of task `mask` alone gives the mask estimator,
    which needs a given scale. Raises InputError.
    """
    if str(run) in _WITHOUT_RUN:
        if mask_run is not None:
            raise InputError(f"{run} finds the leaves itself; leave out the mask model {mask_run}")
        return _WITHOUT_RUN[str(run)]()
    if run is None:
        run, mask_run = PRETRAINED / "area", mask_run or PRETRAINED / "mask"
    if mask_run is not None:
        area, mask = _load_run_of("area", run), _load_run_of("mask", mask_run)
        return RulingEstimator(_make_mask_estimator(mask), _make_area_estimator(area))
    loaded = load_run(Path(run))
    if loaded.spec.task not in _BY_TASK:
        raise InputError(f"{run} is a model of task {loaded.spec.task}, which measures no photos")
    return _BY_TASK[loaded.spec.task](loaded)


def _load_run_of(task: str, path: Path | str) -> Run:
    """Load a run and check its task. Raises InputError."""
    run = load_run(Path(path))
    if run.spec.task != task:
        raise InputError(f"{path} is a model of task {run.spec.task}; name one trained with --task {task}")
    return run
