"""Measure exported files on the same pictures as the estimator that they come from."""

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.common import metrics
from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.letterbox import letterbox_image, letterbox_mask
from laesi_tf.data.manifest import Photo
from laesi_tf.data.synthetic import TEST_INDICES
from laesi_tf.estimators.base import UNKNOWN, Estimator, PhotoInfo
from laesi_tf.estimators.litert_file import LiteRtRunner
from laesi_tf.models.inference import compile_inference
from laesi_tf.models.saved_model import Run
from laesi_tf.synthesis import load_ranges, synthesise

MOST_POINTS = 0.5
"""A file may be so many points worse than its parent: of MRE in percent, or of mIoU x 100."""
_SCENE_PX = 640
_CALIBRATION_PX = 224
_PASSES = 4
"""Successive indices that show the same leaf."""


class Picture(NamedTuple):
    """A scene or a photo of known leaf area."""

    image: RgbImage
    area_cm2: float
    mask: Mask | None
    info: PhotoInfo = UNKNOWN


class Answer(NamedTuple):
    """What is said of a picture: an area, a mask or both."""

    area_cm2: float | None = None
    mask: Mask | None = None


Answerer = Callable[[Picture], Answer]


@dataclass(frozen=True, kw_only=True)
class FileScore:
    """Accuracy of a file, or of its parent, on all pictures; NaN where it says nothing."""

    name: str
    size_mb: float
    mre: float
    """Percent, over the pictures that were measured."""
    miou: float
    worst_difference: float
    """Percent: of areas from the parent's, or 100 minus the IoU x 100 with the parent's mask."""
    host_ms: float
    """Median time on this machine, preparation included."""
    refused: int
    is_kept: bool = True

    def as_row(self) -> str:
        """Return the score as a row of `HEADER`."""
        cells = (
            f"{self.size_mb:7.2f}  {self.mre:7.3f}  {self.miou:6.4f}  {self.worst_difference:7.3f}"
            f"  {self.host_ms:7.1f}  {self.refused:7}"
        ).replace("nan", "  -")
        return f"{self.name:<28}  {cells}  {'' if self.is_kept else 'not kept'}".rstrip()


HEADER = f"{'file':<28}  {'MB':>7}  {'MRE %':>7}  {'mIoU':>6}  {'worst %':>7}  {'host ms':>7}  refused"


def render_pictures(count: int, *, size: int = _SCENE_PX, seed: int = 0) -> list[Picture]:
    """Render `count` test scenes of different leaves."""
    ranges = load_ranges("rendering_2")
    render = tf.function(lambda index: synthesise(seed, size=(size, size), ranges=ranges, index=index))
    pictures = []
    for number in progress_bar(range(count), desc="scenes", unit="scene"):
        scene = render(tf.constant(TEST_INDICES[0] + number * _PASSES, tf.int64))
        mask = scene["mask"].numpy().astype(bool)
        pictures.append(Picture(scene["image"].numpy(), float(scene["area_cm2"]), mask))
    return pictures


def render_calibration(count: int) -> list[Picture]:
    """Render scenes at a network's size for the ranges of int8, of another seed than those to measure on."""
    return render_pictures(count, size=_CALIBRATION_PX, seed=1)


def load_pictures(photos: Sequence[Photo]) -> list[Picture]:
    """Decode the photos of a manifest. Raises InputError for one that cannot be read."""
    return [
        Picture(
            decode_photo(photo.image),
            photo.area_cm2,
            None if photo.mask is None else decode_mask(photo.mask),
            PhotoInfo(grid_mm=photo.grid_mm),
        )
        for photo in progress_bar(photos, desc="photos", unit="photo")
    ]


def answer_with_estimator(estimator: Estimator) -> Answerer:
    """Return a function that measures a picture."""

    def answer(picture: Picture) -> Answer:
        measurement = estimator.measure(picture.image, picture.info)
        return Answer(measurement.area_cm2, measurement.mask)

    return answer


def answer_with_network(run: Run) -> Answerer:
    """Return a function that segments a letterboxed picture with a Keras network."""
    predict = compile_inference(run.model, run.spec.size)

    def answer(picture: Picture) -> Answer:
        image, _ = letterbox_image(picture.image, run.spec.size)
        return Answer(mask=predict(image[np.newaxis])[0, ..., 0] >= 0.5)

    return answer


def answer_with_mask_file(model: bytes, size: tuple[int, int]) -> Answerer:
    """Return a function that segments a letterboxed picture with a graph of kind `mask`."""
    run = LiteRtRunner(model)

    def answer(picture: Picture) -> Answer:
        image, _ = letterbox_image(picture.image, size)
        return Answer(mask=run(photo=image)["leaf"] >= 0.5)

    return answer


def score_answers(
    name: str,
    answerer: Answerer,
    pictures: Sequence[Picture],
    *,
    size_mb: float = math.nan,
    parent: Sequence[Answer] = (),
) -> tuple[FileScore, list[Answer]]:
    """Return the score of a file, and its answers, beside the `parent`'s."""
    answers, times = [], []
    for picture in pictures:
        started = time.perf_counter()
        answers.append(answerer(picture))
        times.append((time.perf_counter() - started) * 1e3)
    areas = [
        (answer.area_cm2, picture.area_cm2)
        for answer, picture in zip(answers, pictures, strict=True)
        if answer.area_cm2 is not None
    ]
    measures_areas = bool(areas) or all(answer.mask is None for answer in answers)
    overlaps = list(_compare_masks(answers, pictures))
    differences = list(_list_differences(answers, parent)) if parent else []
    score = FileScore(
        name=name,
        size_mb=size_mb,
        mre=metrics.mre(*zip(*areas, strict=True)) if areas else math.nan,
        miou=float(np.mean(overlaps)) if overlaps else math.nan,
        worst_difference=max(differences, default=math.nan),
        host_ms=float(np.median(times)),
        refused=len(answers) - len(areas) if measures_areas else 0,
    )
    return score, answers


def is_as_good(score: FileScore, parent: FileScore, *, count: int) -> bool:
    """Return whether a file is at most `MOST_POINTS` worse than its parent on `count` pictures, and refuses
    at most one in twenty that the parent measures."""
    if math.isnan(parent.mre):
        return score.miou >= parent.miou - MOST_POINTS / 100
    return score.mre <= parent.mre + MOST_POINTS and score.refused <= parent.refused + math.ceil(count / 20)


def to_json(scores: Sequence[FileScore]) -> list[dict[str, Any]]:
    """Return the scores as plain values."""
    return [asdict(score) for score in scores]


def _compare_masks(answers: Sequence[Answer], pictures: Sequence[Picture]) -> Iterator[float]:
    for answer, picture in zip(answers, pictures, strict=True):
        if answer.mask is None or picture.mask is None:
            continue
        truth = picture.mask
        if answer.mask.shape != truth.shape:
            height, width = answer.mask.shape
            truth = letterbox_mask(truth, (height, width)).astype(bool)
        yield metrics.miou(answer.mask, truth)


def _list_differences(answers: Sequence[Answer], parent: Sequence[Answer]) -> Iterator[float]:
    for one, other in itertools.zip_longest(answers, parent):
        if one.area_cm2 is not None and other.area_cm2 is not None:
            yield 100 * abs(one.area_cm2 / other.area_cm2 - 1)
        elif one.area_cm2 is None and other.area_cm2 is None and one.mask is not None:
            assert other.mask is not None
            yield 100 * (1 - metrics.miou(one.mask, other.mask))
