"""Benchmark `accuracy`: error, speed, start, memory and size of every method on the same photos.

Errors come from sets of photos of known area. Speed is that of one photo of 12 megapixels, from the bytes of
its JPEG file to its area, as phones take them: photos of the first set, enlarged.
"""

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from PIL import Image

from laesi_tf.benchmarks.first_area import measure_first_area
from laesi_tf.benchmarks.methods import Method
from laesi_tf.benchmarks.timing import MedianIqr
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.decoding import decode_photo
from laesi_tf.data.manifest import Photo
from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.evaluation.photo_scores import score_photos, summarise

_PHONE_PIXELS = 12e6
_JPEG_QUALITY = 92

COLUMNS = (
    *("method", "set", "n", "mre_percent", "mre_low", "mre_high", "median_percent", "p90_percent"),
    *("refused", "silent_errors", "within_1_sd", "within_2_sd"),
    *("ms", "ms_iqr", "first_area_s", "peak_mb", "model_mb", "training_minutes"),
)
"""Columns of the result."""
Row = dict[str, Any]
"""One method on one set, by COLUMNS; None where there is nothing to say."""


class TimedPhoto(NamedTuple):
    """A photo as a phone stores it, and its scale."""

    path: Path
    px_per_mm: float | None


def compare_methods(
    methods: Sequence[Method], sets: Mapping[str, Sequence[Photo]], *, timed: int
) -> list[Row]:
    """Measure all photos of `sets` with each of `methods`, and time each on `timed` photos; return rows.

    A method that needs a scale gets that of the manifest. Raises InputError, also for a method that cannot be
    loaded.
    """
    rows = []
    with tempfile.TemporaryDirectory() as name:
        photos = list(_enlarge_photos(next(iter(sets.values())), timed, Path(name)))
        for method in progress_bar(methods, desc="methods", unit="method"):
            # The process of its own runs alone.
            first = measure_first_area(method, *photos[0])
            estimator = method.load()
            costs = {
                **_time_photos(estimator, photos),
                "first_area_s": first.seconds,
                "peak_mb": first.peak_mb,
                "model_mb": method.model_bytes / 1e6,
                "training_minutes": method.training_minutes,
            }
            for set_name, labelled in sets.items():
                rows.append({"method": method.name, "set": set_name} | _score(estimator, labelled) | costs)
    return rows


def find_front(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of one set that no other beats in both error and time, the fastest first.

    Methods that refuse more than half of the photos take no part.
    """
    front: list[Row] = []
    useful = [row for row in rows if row["mre_percent"] is not None and row["refused"] <= row["n"] / 2]
    for row in sorted(useful, key=lambda row: (row["ms"], row["mre_percent"])):
        if not front or row["mre_percent"] < front[-1]["mre_percent"]:
            front.append(row)
    return front


def _score(estimator: Estimator, photos: Sequence[Photo]) -> Row:
    summary = summarise(score_photos(estimator, photos))
    return {
        "n": summary["n"],
        "mre_percent": summary["mre"],
        "mre_low": summary["mre_low"],
        "mre_high": summary["mre_high"],
        "median_percent": summary["median"],
        "p90_percent": summary["p90"],
        **{name: summary[name] for name in ("refused", "silent_errors", "within_1_sd", "within_2_sd")},
    }


def _time_photos(estimator: Estimator, photos: Sequence[TimedPhoto]) -> Row:
    """Return milliseconds from the bytes of a photo to its area."""
    times = []
    for path, px_per_mm in (photos[0], *photos):
        started = time.perf_counter()
        estimator.measure(decode_photo(path), PhotoInfo(px_per_mm=px_per_mm))
        times.append((time.perf_counter() - started) * 1e3)
    # The first one traces graphs.
    spent = MedianIqr.of(times[1:])
    return {"ms": spent.median, "ms_iqr": spent.iqr}


def _enlarge_photos(photos: Sequence[Photo], count: int, folder: Path) -> Iterator[TimedPhoto]:
    """Write `count` photos, spread over `photos`, as JPEG files of 12 megapixels."""
    spread = np.linspace(0, len(photos) - 1, min(count, len(photos))).astype(int)
    for index in spread:
        photo = photos[index]
        image = decode_photo(photo.image)
        factor = np.sqrt(_PHONE_PIXELS / (image.shape[0] * image.shape[1]))
        enlarged = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        path = folder / f"{index}.jpg"
        Image.fromarray(enlarged).save(path, quality=_JPEG_QUALITY)
        yield TimedPhoto(path, None if photo.px_per_mm is None else photo.px_per_mm * float(factor))
    if not len(spread):
        raise InputError("there is no photo to time")
