"""Load a trained network from a run directory.

The network is built from the five keys of `config.toml` that define it and then filled with the numbers in
`best.keras` or `weights.npz`. Nothing else in the directory is read, so a run from elsewhere runs no code.
"""

import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import keras
import numpy as np

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import BEST_MODEL_FILE, CONFIG_FILE, EXPORTED_WEIGHTS_FILE, require_run
from laesi_tf.common.schema import check_choice, check_number, read_toml
from laesi_tf.models.area_network import TRANSFORMS, build_area_network
from laesi_tf.models.backbone import BACKBONES, FROM_SCRATCH, build_backbone, compute_in
from laesi_tf.models.mask_network import build_mask_network
from laesi_tf.models.ruling_network import build_ruling_network
from laesi_tf.models.weights_file import load_weights


@dataclass(frozen=True, kw_only=True)
class ModelSpec:
    """What defines a network: task, backbone, width `alpha`, input `size` (height, width), area transform.

    Raises InputError for a value that no network has.
    """

    task: str
    backbone: str
    alpha: float
    size: tuple[int, int]
    transform: str

    def __post_init__(self) -> None:
        known: dict[str, Collection[str]] = {
            "task": {**HEAD_BUILDERS, **NETWORK_BUILDERS},
            "backbone": BACKBONES,
            "transform": TRANSFORMS,
        }
        for name, choices in known.items():
            check_choice(name, getattr(self, name), choices)
        check_number("alpha", self.alpha, low=0.1, high=4)
        if len(self.size) != 2 or not all(type(side) is int and 32 <= side <= 4096 for side in self.size):
            raise InputError(f"size {self.size!r} is not [height, width], each between 32 and 4096 pixels")

    @classmethod
    def from_config(cls, values: Mapping[str, Any]) -> "ModelSpec":
        """Take the keys that define a network from the values of a `config.toml`. Raises InputError."""
        names = ("task", "backbone", "alpha", "transform", "size")
        if missing := [name for name in names if name not in values]:
            raise InputError(f"key {missing[0]!r} is missing")
        size = values["size"]
        height_width = tuple(size) if isinstance(size, list | tuple) else (size, size)
        return cls(**{name: values[name] for name in names} | {"size": height_width})


# The one place where a task gets its network: a head on a backbone without classifier, or all of it.
HEAD_BUILDERS: dict[str, Callable[[keras.Model, ModelSpec], keras.Model]] = {
    "area": lambda base, spec: build_area_network(base, transform=spec.transform),
    "mask": lambda base, spec: build_mask_network(base),
}
NETWORK_BUILDERS: dict[str, Callable[[ModelSpec], keras.Model]] = {
    "ruling": lambda spec: build_ruling_network(*spec.size),
}


@dataclass(frozen=True)
class Run:
    """A trained network, [B, H, W, 3] of 0..255 in, and the specification that says what comes out."""

    path: Path
    spec: ModelSpec
    model: keras.Model


class BuiltNetwork(NamedTuple):
    """A network, the part of it that may be pretrained, and the origin of that part's weights."""

    model: keras.Model
    backbone: keras.Model | None
    origin: str


def build_network(
    spec: ModelSpec, *, weights: str = FROM_SCRATCH, precision: str = "float32"
) -> BuiltNetwork:
    """Build the network of `spec`, untrained but for the `weights` of its backbone (see `build_backbone`).

    The backbone computes in `precision`, a Keras dtype policy; variables and all other layers are float32, as
    areas and losses need more than the three digits of 16 bits. Raises InputError for weights that are not
    available, or if the task's network has no backbone.
    """
    if spec.task in HEAD_BUILDERS:
        with compute_in(precision):
            base, origin = build_backbone(spec.backbone, size=spec.size, alpha=spec.alpha, weights=weights)
        return BuiltNetwork(HEAD_BUILDERS[spec.task](base, spec), base, origin)
    if weights not in ("auto", FROM_SCRATCH):
        raise InputError(
            f"weights = {weights!r}: the network of task {spec.task!r} has no pretrained backbone; leave it "
            "out, or name a run of the same task"
        )
    return BuiltNetwork(NETWORK_BUILDERS[spec.task](spec), None, FROM_SCRATCH)


def load_run(path: Path | str) -> Run:
    """Load the best network of a run directory.

    Raises InputError for a run that is missing, broken, or has not reached its first validation.
    """
    path = Path(path)
    require_run(path)
    try:
        spec = ModelSpec.from_config(read_toml(path / CONFIG_FILE))
    except InputError as error:
        raise InputError(f"{path / CONFIG_FILE}: {error}") from None
    exported, best = path / EXPORTED_WEIGHTS_FILE, path / BEST_MODEL_FILE
    if not exported.is_file() and not best.is_file():
        raise InputError(f"run {path} has no {BEST_MODEL_FILE} yet: let train reach its first validation")
    network = build_network(spec).model
    if exported.is_file():
        load_float16(network, exported)
    else:
        load_best(network, best)
    return Run(path, spec, network)


def load_best(network: keras.Model, path: Path) -> None:
    """Read the weights in `best.keras` into `network`. Raises InputError."""
    try:
        load_weights(network, path)
    except InputError as error:
        raise InputError(
            f"{path} is broken or does not fit the {CONFIG_FILE} beside it; train the run again"
        ) from error


def load_float16(network: keras.Model, path: Path) -> None:
    """Read the weights in `weights.npz`, as `export` writes it, into `network`. Raises InputError."""
    try:
        with np.load(path, allow_pickle=False) as saved:
            for name, variable in named_weights(network):
                variable.assign(saved[name].astype(np.float32))
    except (OSError, KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path} is broken or does not fit the {CONFIG_FILE} beside it; export the run again"
        ) from error


def named_weights(network: keras.Model) -> Iterable[tuple[str, Any]]:
    """Pair every weight of `network`, statistics included, with its key in `weights.npz`."""
    return ((f"variable_{index}", variable) for index, variable in enumerate(network.weights))
