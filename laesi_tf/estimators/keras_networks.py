"""Estimators of training runs, whose networks Keras runs in TensorFlow.

Only this module of `estimators` needs TensorFlow to load a network; `factory` imports it for runs that hold
no LiteRT file.
"""

import math
from pathlib import Path

import keras
import numpy as np

from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.base import UNKNOWN, Measurement, PhotoInfo
from laesi_tf.estimators.mask_estimator import MaskEstimator
from laesi_tf.estimators.ruling.ruling_graph import RulingGraph
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.models.area_network import to_area_cm2
from laesi_tf.models.inference import compile_inference
from laesi_tf.models.saved_model import Run, load_run


class MaskOnlyEstimator:
    """A mask network without refinement, for the paper's mIoU and mask pixel error; it refuses the area.

    The mask estimator that measures photos zooms in on leaves and refines their edges, which would hide what
    a network has learned.
    """

    def __init__(self, model: keras.Model, size: tuple[int, int]) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> leaf probability [B, h, w, 1]; `size` is (h, w)."""
        self._size = size
        self._predict = compile_inference(model, size)

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Implement `Estimator.measure`: the mask is where the network's probability is at least one half."""
        small, letterbox = letterbox_image(image, self._size)
        probability = letterbox.crop_and_resize_back(self._predict(small[np.newaxis])[0, ..., 0])
        return Measurement(
            method="mask network", mask=probability >= 0.5, refusal="a mask alone has no scale"
        )


def make_area_estimator(model: keras.Model, input_size: tuple[int, int], transform: str) -> AreaEstimator:
    """Return the estimator of a model [B, h, w, 3] in 0..255 -> [B, n].

    Its first output is the transformed area, its second the logarithm of the scale. `transform` is what
    training applied to the area.
    """
    predict = compile_inference(model, input_size)

    def predict_area(image: RgbImage) -> tuple[float, float]:
        output = predict(image[np.newaxis])[0]
        px_per_mm = float(np.exp(np.float64(output[1]))) if len(output) > 1 else math.nan
        return float(to_area_cm2(output[0], transform)), px_per_mm

    return AreaEstimator(predict_area, input_size)


def make_mask_estimator(model: keras.Model, input_size: tuple[int, int]) -> MaskEstimator:
    """Return the estimator of a model [B, h, w, 3] in 0..255 -> leaf probability [B, h, w, 1]."""
    return MaskEstimator(compile_inference(model, input_size), input_size)


def make_sheet_reader(model: keras.Model) -> SheetReader:
    """Return the reader of a ruling network of any input size, [B, h, w, 3] -> logits."""
    return SheetReader(RulingGraph(model))


def load_area_run(path: Path) -> AreaEstimator:
    """Load the estimator of a run of task area. Raises InputError."""
    run = load_run_of("area", path)
    return make_area_estimator(run.model, run.spec.size, run.spec.transform)


def load_mask_run(path: Path) -> MaskEstimator:
    """Load the estimator of a run of task mask. Raises InputError."""
    run = load_run_of("mask", path)
    return make_mask_estimator(run.model, run.spec.size)


def load_ruling_run(path: Path) -> SheetReader:
    """Load the reader of a run of task ruling. Raises InputError."""
    return make_sheet_reader(load_run_of("ruling", path).model)


def load_run_of(task: str, path: Path | str) -> Run:
    """Load a run and check its task. Raises InputError."""
    run = load_run(Path(path))
    if run.spec.task != task:
        raise InputError(f"{path} is a model of task {run.spec.task}; name one trained with --task {task}")
    return run
