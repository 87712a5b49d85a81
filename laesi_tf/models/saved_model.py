"""Load a trained network from a run directory."""

import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import keras
import numpy as np

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import BEST_MODEL_FILE, CONFIG_FILE, EXPORTED_WEIGHTS_FILE, RANGES_FILE
from laesi_tf.models.backbone import FROM_SCRATCH, build_backbone
from laesi_tf.training import config_files
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import make_task

PRETRAINED = Path(__file__).parents[1] / "pretrained"
"""Folders `area` and `mask`: the exported runs that come with the package."""


@dataclass(frozen=True)
class Run:
    """A trained model, [B, H, W, 3] of 0..255 in, and the configuration that says what comes out."""

    path: Path
    config: TrainConfig
    model: keras.Model


def load_run(path: Path | str) -> Run:
    """The configuration and best model in a run's folder; InputError if missing, unfinished or broken."""
    path = Path(path)
    if not (path / CONFIG_FILE).is_file():
        raise InputError(
            f"no run in {path}: it has no {CONFIG_FILE}; name a folder that train wrote with --out"
        )
    config = config_files.load_config(path / CONFIG_FILE)
    if (path / RANGES_FILE).is_file():  # they may have changed, or be gone, where they came from
        config = replace(config, ranges=str(path / RANGES_FILE))
    best = path / BEST_MODEL_FILE
    if (path / EXPORTED_WEIGHTS_FILE).is_file():
        return Run(path, config, load_float16(path / EXPORTED_WEIGHTS_FILE, config))
    if not best.is_file():
        raise InputError(f"run {path} has no {BEST_MODEL_FILE} yet: let train reach its first validation")
    try:
        model = keras.models.load_model(best, compile=False)
    except Exception as error:  # zipfile, h5py, JSON and Keras each have their own
        raise InputError(f"{best} is broken or from another Keras version: train it again") from error
    return Run(path, config, model)


def load_float16(path: Path, config: TrainConfig) -> keras.Model:
    base, _ = build_backbone(config.backbone, size=config.size, alpha=config.alpha, weights=FROM_SCRATCH)
    model = make_task(config).build(base)
    try:
        with np.load(path, allow_pickle=False) as saved:
            for index, variable in numbered_weights(model):
                variable.assign(saved[f"variable_{index}"].astype(np.float32))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path} is broken or does not fit its {CONFIG_FILE}: export the run again"
        ) from error
    return model


def numbered_weights(model: keras.Model) -> Iterable[tuple[int, Any]]:
    """The variables of a model that hold what it learned, statistics included, in its order."""
    return enumerate(model.weights)
