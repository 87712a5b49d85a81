"""Load the estimator that training runs or the name of a method stand for.

Every estimator is registered here, in `_BY_TASK` or `WITHOUT_RUN`.
"""

import functools
from collections.abc import Callable
from pathlib import Path

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import LITERT_SUFFIX
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.colour_threshold import ColourThreshold
from laesi_tf.estimators.easy_leaf_area import EasyLeafArea
from laesi_tf.estimators.litert_estimator import load_litert_estimator
from laesi_tf.estimators.mask_estimator import MaskEstimator
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.ruling_estimator import RulingEstimator
from laesi_tf.estimators.scan.scan_estimator import ScanEstimator
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

WITHOUT_RUN: dict[str, Callable[[], Estimator]] = {
    "rule_based": EasyLeafArea,
    "excess_green": ColourThreshold,
}
"""Estimators without a network, by the name that stands in place of a run."""


def load_estimator(
    run: Path | str | None = None,
    *,
    mask_run: Path | str | None = None,
    ruling_run: Path | str | None = None,
    guess: bool = False,
    has_known_scale: bool = False,
) -> Estimator:
    """Load the estimator for the training run in folder `run`; without one, the ruling estimator.

    A name of `WITHOUT_RUN` in place of a run gives that estimator: `rule_based` is Easy Leaf Area, which
    takes the scale from a red square, `excess_green` a colour threshold, which needs a given one. A run of
    task `area` gives the area estimator, a run of task `mask` the mask estimator, which needs a given scale.
    A `.tflite` file that `export` wrote measures as it stands.

    The ruling estimator takes `mask_run` and `ruling_run` in place of the shipped runs; with `guess`, the
    area run `run`, or the shipped one, guesses where no ruling is read. With `has_known_scale`,
    `PhotoInfo.px_per_mm` will be given and no ruling is read: without a run, leaves are found on a plain
    background by its colour, else by the mask network; with `mask_run`, by that network alone. Raises
    InputError.
    """
    if has_known_scale and run is None:
        if mask_run is not None:
            return _make_mask_estimator(load_run_of("mask", mask_run))
        return ScanEstimator(lambda: _make_mask_estimator(load_run_of("mask", PRETRAINED / "mask")))
    if run is None or (guess and str(run) not in WITHOUT_RUN and Path(run).suffix != LITERT_SUFFIX):
        return _load_ruling_estimator(run, mask_run=mask_run, ruling_run=ruling_run, guess=guess)
    for option, given in (("--mask-model", mask_run), ("--ruling-model", ruling_run), ("--guess", guess)):
        if given:
            raise InputError(f"{run} measures without {option}; leave out one of them")
    if str(run) in WITHOUT_RUN:
        return WITHOUT_RUN[str(run)]()
    if Path(run).suffix == LITERT_SUFFIX:
        return load_litert_estimator(Path(run), reads_ruling=not has_known_scale)
    loaded = load_run(Path(run))
    if loaded.spec.task not in _BY_TASK:
        raise InputError(f"{run} is a model of task {loaded.spec.task}, which measures no photos alone")
    return _BY_TASK[loaded.spec.task](loaded)


def _load_ruling_estimator(
    area_run: Path | str | None,
    *,
    mask_run: Path | str | None,
    ruling_run: Path | str | None,
    guess: bool,
) -> RulingEstimator:
    mask = load_run_of("mask", mask_run or PRETRAINED / "mask")
    reader = load_shipped_reader() if ruling_run is None else _load_reader(ruling_run)
    guesser = _make_area_estimator(load_run_of("area", area_run or PRETRAINED / "area")) if guess else None
    return RulingEstimator(_make_mask_estimator(mask), reader, guesser=guesser)


@functools.cache
def load_shipped_reader() -> SheetReader:
    """Load the reader of rulings that comes with the package, once: its graphs take seconds to compile."""
    return _load_reader(PRETRAINED / "ruling")


def _load_reader(run: Path | str) -> SheetReader:
    return SheetReader(load_run_of("ruling", run).model)


def load_run_of(task: str, path: Path | str) -> Run:
    """Load a run and check its task. Raises InputError."""
    run = load_run(Path(path))
    if run.spec.task != task:
        raise InputError(f"{path} is a model of task {run.spec.task}; name one trained with --task {task}")
    return run
