"""Score an estimator on photos of known leaf area, per subset of the manifest.

MRE, median and 90th percentile are relative errors of the area in percent, over the photos that were not
refused; mIoU (the leaf's intersection over union) and MPE (relative error of the count of leaf pixels) are
fractions, over the photos that have a mask.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from laesi_tf.common import metrics
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.manifest import Photo
from laesi_tf.data.prefetch import prefetch
from laesi_tf.estimators.base import Estimator, Measurement, PhotoInfo

ALL = "all"
_RESAMPLES = 2000


@dataclass(frozen=True, kw_only=True)
class PhotoScore:
    """What came of one photo of the manifest; what is not known is None."""

    photo: Photo
    method: str | None = None
    predicted_cm2: float | None = None
    iou: float | None = None
    pixel_error: float | None = None
    refusal: str | None = None
    error: str | None = None
    """Why the photo was skipped: its file or its mask's is bad."""

    @property
    def relative_error(self) -> float | None:
        """(predicted - true) / true in percent."""
        if self.predicted_cm2 is None:
            return None
        return 100.0 * (self.predicted_cm2 / self.photo.area_cm2 - 1.0)


def score_photos(estimator: Estimator, photos: Sequence[Photo]) -> list[PhotoScore]:
    """Measure `photos`; those that cannot be read become scores with an error.

    The manifest's scale and grid are handed to the estimator as known. Raises InputError when no photo can be
    read.
    """
    scores = []
    decoded = progress_bar(
        prefetch(load_photo_and_mask, photos), total=len(photos), desc="measuring", unit="photo"
    )
    for photo, pictures in decoded:
        if isinstance(pictures, InputError):
            scores.append(PhotoScore(photo=photo, error=str(pictures)))
        else:
            image, mask = pictures
            scores.append(_score_photo(photo, estimator.measure(image, photo_info(photo)), mask))
    if all(score.error for score in scores):
        raise InputError(f"none of the {len(scores)} photos can be read; first: {scores[0].error}")
    return scores


def group_by_subset(scores: Sequence[PhotoScore]) -> dict[str, list[PhotoScore]]:
    """All scores, those of each subset, and those on each paper that is not ruled in millimetres."""
    groups: dict[str, list[PhotoScore]] = {ALL: list(scores)}
    for name in sorted({score.photo.subset for score in scores if score.photo.subset} - {ALL}):
        groups[name] = [score for score in scores if score.photo.subset == name]
    for grid in sorted({score.photo.grid_mm for score in scores} - {1.0}):
        groups[f"grid {grid:g} mm"] = [score for score in scores if score.photo.grid_mm == grid]
    return groups


def summarise(scores: Sequence[PhotoScore]) -> dict[str, float | int | None]:
    """The figures of one subset, n counting the photos that were read; None where nothing is averaged."""
    done = [score for score in scores if score.error is None]
    areas = [(score.predicted_cm2, score.photo.area_cm2) for score in done if score.predicted_cm2 is not None]
    predicted, true = np.array(areas, np.float64).reshape(-1, 2).T
    low, high = bootstrap_interval(metrics.relative_errors(predicted, true)) if areas else (None, None)

    def of_areas(figure: Callable[[np.ndarray, np.ndarray], float]) -> float | None:
        return figure(predicted, true) if areas else None

    return {
        "n": len(done),
        "mre": of_areas(metrics.mre),
        "mre_low": low,
        "mre_high": high,
        "median": of_areas(metrics.median_relative_error),
        "p90": of_areas(metrics.p90_relative_error),
        "miou": _mean([score.iou for score in done]),
        "mpe": _mean([score.pixel_error for score in done]),
        "refused": sum(score.refusal is not None for score in done),
        "refused_share": _mean([float(score.refusal is not None) for score in done]),
        "skipped": len(scores) - len(done),
    }


def bootstrap_interval(errors: np.ndarray) -> tuple[float, float]:
    """The 95 % bootstrap interval of the mean of `errors` [N], N >= 1: what another such set might give.

    It takes photos for independent; where a leaf or a sheet is on several of them it is somewhat too narrow.
    """
    generator = np.random.default_rng(0)
    means = [generator.choice(errors, errors.size).mean() for _ in range(_RESAMPLES)]
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def sort_worst_first(scores: Sequence[PhotoScore]) -> list[PhotoScore]:
    """The scores with an area or an IoU, the worst first: by area where any has one, otherwise by IoU."""
    with_area = [score for score in scores if score.relative_error is not None]
    if with_area:
        return sorted(with_area, key=lambda score: -abs(score.relative_error or 0.0))
    return sorted((score for score in scores if score.iou is not None), key=lambda score: score.iou or 0.0)


def load_photo_and_mask(photo: Photo) -> tuple[np.ndarray, np.ndarray | None]:
    """The photo, uint8 [H, W, 3], and its true mask, bool [H, W], or None. Raises InputError."""
    image = decode_photo(photo.image)
    mask = None if photo.mask is None else decode_mask(photo.mask)
    if mask is not None and mask.shape != image.shape[:2]:
        raise InputError(f"mask {photo.mask} is not of its image's size; draw it on the image itself")
    return image, mask


def photo_info(photo: Photo) -> PhotoInfo:
    """What the manifest tells an estimator about the photo."""
    return PhotoInfo(px_per_mm=photo.px_per_mm, grid_mm=photo.grid_mm)


def _score_photo(photo: Photo, measured: Measurement, mask: np.ndarray | None) -> PhotoScore:
    iou = pixel_error = None
    if mask is not None and measured.mask is not None:
        iou = metrics.miou(measured.mask, mask)
        pixel_error = metrics.mpe(measured.mask, mask)
    return PhotoScore(
        photo=photo,
        method=measured.method,
        predicted_cm2=measured.area_cm2,
        iou=iou,
        pixel_error=pixel_error,
        refusal=measured.refusal,
    )


def _mean(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None
