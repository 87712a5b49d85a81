"""The methods that benchmarks compare: every estimator there is, the shipped networks, and further models."""

import functools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import BEST_MODEL_FILE, LITERT_SUFFIX, METRICS_FILE, PRETRAINED
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.factory import WITHOUT_RUN, load_estimator
from laesi_tf.estimators.reduced_photo import ReducedPhoto

SHIPPED = "ruling x silhouette"
"""Name of the method that `predict` measures with."""
WORKING_SIDES_PX = (640, 1024)
"""Longer sides of the photo at which it is compared beside all pixels."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A way to measure a photo; of plain values, so that another process can load it."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    """Keyword arguments of `load_estimator`, paths as text."""
    working_px: int | None = None
    """Longer side of the photo that the estimator sees; None for all pixels."""
    models: tuple[str, ...] = ()
    """Run directories and files that it loads."""

    def load(self) -> Estimator:
        """Load the estimator. Raises InputError."""
        estimator = load_estimator(**self.options)
        return estimator if self.working_px is None else ReducedPhoto(estimator, self.working_px)

    @functools.cached_property
    def digest(self) -> str:
        """What changes with its models."""
        files = sorted(file for model in self.models for file in _list_files(Path(model)))
        return " ".join(map(short_sha256, files))

    @functools.cached_property
    def model_bytes(self) -> int:
        """Size of its models."""
        return sum(file.stat().st_size for model in self.models for file in _list_files(Path(model)))

    @functools.cached_property
    def training_minutes(self) -> float | None:
        """Minutes that its networks were trained; 0 without networks, None where a run does not say."""
        minutes = [_read_minutes(Path(model)) for model in self.models]
        known = [value for value in minutes if value is not None]
        return sum(known) if len(known) == len(minutes) else None


def list_methods(models: Sequence[Path] = ()) -> list[Method]:
    """Return all methods: rules, the shipped networks alone and together, and one for each of `models`.

    A model is a training run that measures alone or a file that `export` wrote. Raises InputError for two of
    one name.
    """
    area, mask, ruling = (str(PRETRAINED / task) for task in ("area", "mask", "ruling"))
    shipped = [
        Method(name=f"{SHIPPED}, {side} px", working_px=side, models=(mask, ruling))
        for side in WORKING_SIDES_PX
    ]
    methods = [
        *(Method(name=name, options={"run": name}) for name in WITHOUT_RUN),
        Method(name="regression", options={"run": area}, models=(area,)),
        Method(
            name="silhouette x given scale",
            options={"mask_run": mask, "has_known_scale": True},
            models=(mask,),
        ),
        *shipped,
        Method(name=SHIPPED, models=(mask, ruling)),
        *(Method(name=model.stem, options={"run": str(model)}, models=(str(model),)) for model in models),
    ]
    names = [method.name for method in methods]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two models are called {repeated[0]}; rename one of them")
    return methods


def _list_files(model: Path) -> list[Path]:
    """Return the files that are loaded of a run or an exported file."""
    if model.is_file():
        return [model]
    return list(model.glob(f"*{LITERT_SUFFIX}")) or list(model.glob(BEST_MODEL_FILE))


def _read_minutes(model: Path) -> float | None:
    if model.suffix == LITERT_SUFFIX:
        return None
    try:
        minutes = json.loads((model / METRICS_FILE).read_text(encoding="utf-8")).get("minutes")
    except (OSError, ValueError):
        return None
    return None if minutes is None else float(minutes)
