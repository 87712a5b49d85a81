"""Score an estimator on photos of known leaf area, per subset of the manifest.

MRE, median and 90th percentile are relative errors of the area in percent, over the photos that were not
refused; mIoU (the leaf's intersection over union) and MPE (relative error of the count of leaf pixels) are
fractions, over the photos that have a mask.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from laesi_tf.common import metrics
from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.manifest import Photo
from laesi_tf.data.prefetch import prefetch
from laesi_tf.estimators.base import Estimator, Measurement, PhotoInfo

ALL = "all"
"""Name of the group of all photos."""
_RESAMPLES = 2000
_FAR_OFF_PERCENT = 10.0
"""An area farther off than this should have been refused."""

Summary = dict[str, float | int | None]
"""Metrics of a group of photos by name."""


@dataclass(frozen=True, kw_only=True)
class PhotoScore:
    """The result for one photo of the manifest; what is not known is None."""

    photo: Photo
    method: str | None = None
    predicted_cm2: float | None = None
    uncertainty_cm2: float | None = None
    scale_error: float | None = None
    """(px/mm read from the ruling - the manifest's) / the manifest's in percent, at the largest leaf."""
    iou: float | None = None
    pixel_error: float | None = None
    refusal: str | None = None
    error: str | None = None
    """Why the photo was skipped: its file or its mask's cannot be read."""

    @property
    def relative_error(self) -> float | None:
        """(predicted - true) / true in percent."""
        if self.predicted_cm2 is None:
            return None
        return 100.0 * (self.predicted_cm2 / self.photo.seen_cm2 - 1.0)

    @property
    def is_silent_error(self) -> bool:
        """Whether the photo got an area that is far off."""
        return self.relative_error is not None and abs(self.relative_error) > _FAR_OFF_PERCENT

    def is_within(self, deviations: float) -> bool | None:
        """Return whether the true area lies within so many standard deviations of the predicted one."""
        if self.predicted_cm2 is None or self.uncertainty_cm2 is None:
            return None
        return abs(self.predicted_cm2 - self.photo.seen_cm2) <= deviations * self.uncertainty_cm2


def score_photos(estimator: Estimator, photos: Sequence[Photo]) -> list[PhotoScore]:
    """Measure `photos` with the manifest's scale and grid and compare them with their true areas and masks.

    Photos that cannot be read become scores with an error. Raises InputError when none can be read.
    """
    scores = []
    loaded = prefetch(load_photo_and_mask, photos)
    for photo, content in progress_bar(loaded, total=len(photos), desc="measuring", unit="photo"):
        if isinstance(content, InputError):
            scores.append(PhotoScore(photo=photo, error=str(content)))
        else:
            image, mask = content
            scores.append(_score_photo(photo, estimator.measure(image, photo_info(photo)), mask))
    if all(score.error for score in scores):
        raise InputError(f"none of the {len(scores)} photos can be read; first: {scores[0].error}")
    return scores


def group_by_subset(scores: Sequence[PhotoScore]) -> dict[str, list[PhotoScore]]:
    """Return all scores, those of each subset, and those of each paper other than millimetre paper."""
    groups: dict[str, list[PhotoScore]] = {ALL: list(scores)}
    for name in sorted({score.photo.subset for score in scores if score.photo.subset} - {ALL}):
        groups[name] = [score for score in scores if score.photo.subset == name]
    for grid in sorted({score.photo.grid_mm or 1.0 for score in scores} - {1.0}):
        groups[f"grid {grid:g} mm"] = [score for score in scores if score.photo.grid_mm == grid]
    return groups


def summarise(scores: Sequence[PhotoScore]) -> Summary:
    """Return the metrics of a group; None where there is nothing to average.

    `n` counts the photos that could be read.
    """
    read = [score for score in scores if score.error is None]
    areas = [(score.predicted_cm2, score.photo.seen_cm2) for score in read if score.predicted_cm2 is not None]
    predicted, true = np.array(areas, np.float64).reshape(-1, 2).T
    low, high = bootstrap_interval(metrics.relative_errors(predicted, true)) if areas else (None, None)

    def average(metric: Callable[[NDArray[np.float64], NDArray[np.float64]], float]) -> float | None:
        return metric(predicted, true) if areas else None

    return {
        "n": len(read),
        "mre": average(metrics.mre),
        "mre_low": low,
        "mre_high": high,
        "median": average(metrics.median_relative_error),
        "p90": average(metrics.p90_relative_error),
        "within_1_sd": _mean([score.is_within(1) for score in read]),
        "within_2_sd": _mean([score.is_within(2) for score in read]),
        "silent_errors": sum(score.is_silent_error for score in read),
        "scale_median": _percentile([score.scale_error for score in read], 50),
        "scale_p90": _percentile([score.scale_error for score in read], 90),
        "miou": _mean([score.iou for score in read]),
        "mpe": _mean([score.pixel_error for score in read]),
        "refused": sum(score.refusal is not None for score in read),
        "refused_share": _mean([float(score.refusal is not None) for score in read]),
        "skipped": len(scores) - len(read),
    }


def bootstrap_interval(errors: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap confidence interval of the mean of `errors` [N], N >= 1.

    Photos count as independent; where several show the same leaf or sheet the interval is too narrow.
    """
    if errors.size == 1:
        return float(errors[0]), float(errors[0])
    resampled = np.random.default_rng(0).integers(0, errors.size, (_RESAMPLES, errors.size))
    low, high = np.percentile(errors[resampled].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def sort_worst_first(scores: Sequence[PhotoScore]) -> list[PhotoScore]:
    """Return the scores with an area by falling error; where no photo has an area, by rising IoU."""
    with_area = [score for score in scores if score.relative_error is not None]
    if with_area:
        return sorted(with_area, key=lambda score: -abs(score.relative_error or 0.0))
    return sorted((score for score in scores if score.iou is not None), key=lambda score: score.iou or 0.0)


def load_photo_and_mask(photo: Photo) -> tuple[RgbImage, Mask | None]:
    """Return a photo, uint8 [H, W, 3], and its true mask, bool [H, W], or None. Raises InputError."""
    image = decode_photo(photo.image)
    mask = None if photo.mask is None else decode_mask(photo.mask)
    if mask is not None and mask.shape != image.shape[:2]:
        raise InputError(
            f"mask {photo.mask} is {mask.shape[1]} x {mask.shape[0]} pixels but its image "
            f"{image.shape[1]} x {image.shape[0]}; draw it on the image itself"
        )
    return image, mask


def photo_info(photo: Photo) -> PhotoInfo:
    """Return what the manifest says about the photo before it is measured."""
    return PhotoInfo(px_per_mm=photo.px_per_mm, grid_mm=photo.grid_mm)


def _score_photo(photo: Photo, measurement: Measurement, mask: Mask | None) -> PhotoScore:
    iou = pixel_error = None
    if mask is not None and measurement.mask is not None:
        iou = metrics.miou(measurement.mask, mask)
        pixel_error = metrics.mpe(measurement.mask, mask)
    largest = max(measurement.leaves, key=lambda leaf: leaf.area_cm2 or 0.0, default=None)
    scale_error = None
    if measurement.camera and photo.px_per_mm and largest and largest.px_per_mm:
        scale_error = 100.0 * (largest.px_per_mm / photo.px_per_mm - 1.0)
    return PhotoScore(
        photo=photo,
        scale_error=scale_error,
        method=measurement.method,
        predicted_cm2=measurement.area_cm2,
        uncertainty_cm2=measurement.uncertainty_cm2,
        iou=iou,
        pixel_error=pixel_error,
        refusal=measurement.refusal,
    )


def _percentile(errors: Sequence[float | None], rank: float) -> float | None:
    """Return the percentile `rank` of the known `errors` without their signs."""
    known = [abs(error) for error in errors if error is not None]
    return float(np.percentile(known, rank)) if known else None


def _mean(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None
