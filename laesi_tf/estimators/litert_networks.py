"""The networks of an exported run, and the stages of a ruling, as LiteRT runs them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import NETWORK_FILE, READING_FILE
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.litert_file import LiteRtFile, LiteRtRunner, read_litert_file
from laesi_tf.estimators.mask_estimator import MaskEstimator
from laesi_tf.estimators.ruling.params import RulingReaderParams
from laesi_tf.estimators.ruling.sheet_reader import SheetReader

LOGITS = ("logits_0", "logits_1", "logits_2", "logits_3")
"""Names of inputs: the network's answers, by level."""


def load_area_network(run: Path) -> AreaEstimator:
    """Load the estimator of an exported run of task area. Raises InputError."""
    file = _read_network("area", run)
    infer = LiteRtRunner(file.model)

    def predict(image: RgbImage) -> tuple[float, float]:
        output = infer(photo=image)
        return float(output["area_cm2"]), float(output["px_per_mm"])

    height, width = file.metadata["input_size"]
    return AreaEstimator(predict, (height, width))


def load_mask_network(run: Path) -> MaskEstimator:
    """Load the estimator of an exported run of task mask. Raises InputError."""
    file = _read_network("mask", run)
    infer = LiteRtRunner(file.model)

    def predict(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        return np.stack([infer(photo=image)["leaf"] for image in images])[..., np.newaxis]

    height, width = file.metadata["input_size"]
    return MaskEstimator(predict, (height, width))


def load_ruling_network(run: Path) -> SheetReader:
    """Load the reader of an exported run of task ruling. Raises InputError."""
    network, reading = _read_network("ruling", run), _read_network("reading", run, READING_FILE)
    return SheetReader(LiteRtRulingStages(network.model, reading.model))


class LiteRtRulingStages:
    """The stages of `RulingStages` in files of kinds `ruling` and `reading`, converted with the default
    parameters."""

    def __init__(self, network: bytes, reading: bytes) -> None:
        """Take the graph of the network and that of the other stages."""
        self._network, self._reading = LiteRtRunner(network), LiteRtRunner(reading)

    def with_params(self, params: RulingReaderParams) -> "LiteRtRulingStages":
        """Return these stages if `params` are what they were converted with, else raise ValueError."""
        default = RulingReaderParams()
        # These two are used outside the stages.
        judge = replace(params.judge, scale_error=default.judge.scale_error)
        if replace(params, judge=judge, sheet_agreement=default.sheet_agreement) != default:
            raise ValueError("a LiteRT file computes with the parameters that it was converted with")
        return self

    def ask_network(self, images: NDArray[np.float32]) -> NDArray[Any]:
        """As `RulingStages.ask_network`, for one image."""
        return self._network(images=images)["logits"]

    def needs_full_resolution(self, coarse: Sequence[NDArray[Any]], size: NDArray[Any]) -> bool:
        """As `RulingStages.needs_full_resolution`."""
        logits = dict(zip(LOGITS[1:], coarse, strict=True))
        return bool(self._reading("needs_full_resolution", size=size, **logits)["is_needed"])

    def read(
        self,
        frame: RgbImage,
        coarser: NDArray[Any],
        logits: Sequence[NDArray[Any]],
        size: NDArray[Any],
        is_full: np.bool_,
        grid_mm: np.float32,
    ) -> dict[str, NDArray[Any]]:
        """As `RulingStages.read`."""
        if is_full:
            # Else 80 MB beside those of the reading; the next photo takes 0.05 s to prepare them again.
            self._network.release_memory()
        return self._reading(
            "read",
            frame=frame,
            coarser=coarser,
            size=size,
            is_full=np.int32(is_full),
            grid_mm=grid_mm,
            **dict(zip(LOGITS, logits, strict=True)),
        )


def _read_network(task: str, run: Path, name: str = NETWORK_FILE) -> LiteRtFile:
    """Read a LiteRT file of an exported run and check its kind. Raises InputError."""
    file = read_litert_file(run / name)
    kind = file.metadata.get("kind")
    if kind != task:
        raise InputError(f"{run} is a model of task {kind}; name one trained with --task {task}")
    return file
