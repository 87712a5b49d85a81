"""Load the estimator that training runs or the name of a method stand for.

Every estimator is registered here, in `_ALONE` or `WITHOUT_RUN`. Runs that hold a LiteRT file, as the
shipped ones do, are run by LiteRT, all others by Keras in TensorFlow, which is imported for them alone.
"""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import CONFIG_FILE, LITERT_SUFFIX, PRETRAINED, needs_tensorflow, require_run
from laesi_tf.common.schema import read_toml
from laesi_tf.common.tensorflow import require_tensorflow
from laesi_tf.estimators import litert_networks
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.colour_threshold import ColourThreshold
from laesi_tf.estimators.easy_leaf_area import EasyLeafArea
from laesi_tf.estimators.litert_estimator import load_litert_estimator
from laesi_tf.estimators.mask_estimator import MaskEstimator
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.ruling_estimator import RulingEstimator
from laesi_tf.estimators.scan.scan_estimator import ScanEstimator

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
    in_keras: bool = False,
) -> Estimator:
    """Load the estimator for the training run in folder `run`; without one, the ruling estimator.

    A name of `WITHOUT_RUN` in place of a run gives that estimator: `rule_based` is Easy Leaf Area, which
    takes the scale from a red square, `excess_green` a colour threshold, which needs a given one. A run of
    task `area` gives the area estimator, a run of task `mask` the mask estimator, which needs a given scale.
    A `.tflite` file that `export` wrote measures as it stands.

    The ruling estimator takes `mask_run` and `ruling_run` in place of the shipped runs; with `guess`, the
    area run `run`, or the shipped one, guesses where no ruling is read. With `has_known_scale`,
    `PhotoInfo.px_per_mm` will be given and no ruling is read: without a run, leaves are found on a plain
    background by its colour, else by the mask network; with `mask_run`, by that network alone. With
    `in_keras`, runs that hold a LiteRT file are run by Keras, too: parameters of their stages can then be
    replaced. Raises InputError.
    """
    if has_known_scale and run is None:
        if mask_run is not None:
            return _load_mask(mask_run, in_keras)
        mask = _load_mask(PRETRAINED / "mask", in_keras)
        return ScanEstimator(lambda: mask)
    if run is None or (guess and str(run) not in WITHOUT_RUN and Path(run).suffix != LITERT_SUFFIX):
        return _load_ruling_estimator(
            run, mask_run=mask_run, ruling_run=ruling_run, guess=guess, in_keras=in_keras
        )
    for option, given in (("--mask-model", mask_run), ("--ruling-model", ruling_run), ("--guess", guess)):
        if given:
            raise InputError(f"{run} measures without {option}; leave out one of them")
    if str(run) in WITHOUT_RUN:
        return WITHOUT_RUN[str(run)]()
    if Path(run).suffix == LITERT_SUFFIX:
        return load_litert_estimator(Path(run), reads_ruling=not has_known_scale)
    task = _read_task(Path(run))
    if task not in _ALONE:
        raise InputError(f"{run} is a model of task {task}, which measures no photos alone")
    return _ALONE[task](run, in_keras)


def _load_ruling_estimator(
    area_run: Path | str | None,
    *,
    mask_run: Path | str | None,
    ruling_run: Path | str | None,
    guess: bool,
    in_keras: bool,
) -> RulingEstimator:
    mask = _load_mask(mask_run or PRETRAINED / "mask", in_keras)
    if ruling_run is None:
        reader = load_shipped_reader(in_keras=in_keras)
    else:
        reader = _load_reader(ruling_run, in_keras)
    guesser = _load_area(area_run or PRETRAINED / "area", in_keras) if guess else None
    return RulingEstimator(mask, reader, guesser=guesser)


@functools.cache
def load_shipped_reader(*, in_keras: bool = False) -> SheetReader:
    """Load the reader of rulings that comes with the package, once: in TensorFlow its graphs take seconds to
    compile."""
    return _load_reader(PRETRAINED / "ruling", in_keras)


def _load_area(run: Path | str, in_keras: bool) -> AreaEstimator:
    if _runs_in_litert(run, in_keras):
        return litert_networks.load_area_network(Path(run))
    return _import_keras_networks(run).load_area_run(Path(run))


def _load_mask(run: Path | str, in_keras: bool) -> MaskEstimator:
    if _runs_in_litert(run, in_keras):
        return litert_networks.load_mask_network(Path(run))
    return _import_keras_networks(run).load_mask_run(Path(run))


def _load_reader(run: Path | str, in_keras: bool) -> SheetReader:
    if _runs_in_litert(run, in_keras):
        return litert_networks.load_ruling_network(Path(run))
    return _import_keras_networks(run).load_ruling_run(Path(run))


_ALONE: dict[Any, Callable[[Path | str, bool], Estimator]] = {"area": _load_area, "mask": _load_mask}
"""The estimator that a run of each task is alone."""


def _runs_in_litert(run: Path | str, in_keras: bool) -> bool:
    return Path(run).is_dir() and not needs_tensorflow(run) and not in_keras


def _import_keras_networks(run: Path | str) -> Any:
    """Return the module that loads runs with TensorFlow. Raises InputError where that is not installed."""
    require_run(run)
    require_tensorflow(f"the training run {run}")
    from laesi_tf.estimators import keras_networks

    return keras_networks


def _read_task(run: Path) -> Any:
    """Return the task of the run in a folder. Raises InputError."""
    require_run(run)
    try:
        return read_toml(run / CONFIG_FILE).get("task")
    except InputError as error:
        raise InputError(f"{run / CONFIG_FILE}: {error}") from None
