"""Folders of small photos and an estimator without networks, for tests of `predict`."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from laesi_tf import predict as command
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo


class MeanLevel:
    """An estimator whose area is the mean level of the photo; it counts its calls and may raise an error."""

    def __init__(self, *, stop_after: int | None = None, error: BaseException | None = None) -> None:
        self.calls = 0
        self.stop_after, self.error = stop_after, error

    def measure(self, image: np.ndarray, info: PhotoInfo = UNKNOWN) -> Measurement:
        if self.error is not None and self.calls == self.stop_after:
            raise self.error
        self.calls += 1
        level = float(image.mean())
        if level < 1:
            return Measurement(method="mean", refusal="it is black")
        leaf = LeafMeasurement(area_cm2=level, uncertainty_cm2=level / 100, px_per_mm=info.px_per_mm)
        return Measurement(method="mean", leaves=(leaf,))


def save(path: Path, level: int = 100, **options: object) -> Path:
    """Save a grey photo."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (40, 30), (level,) * 3).save(path, **options)
    return path


def predict(out: Path, *arguments: object) -> list[dict[str, str]]:
    """Run the command and return the rows of areas.csv."""
    command.main([*map(str, arguments), "--out", str(out)])
    return read_rows(out)


def read_rows(out: Path) -> list[dict[str, str]]:
    with (out / "areas.csv").open(newline="", encoding="utf-8-sig") as file:
        return list(csv.DictReader(file))


def names(rows: list[dict[str, str]]) -> list[str]:
    return [Path(row["photo"]).name for row in rows]


Install = Callable[[MeanLevel], MeanLevel]
