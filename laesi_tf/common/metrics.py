"""The paper's figures of merit, in numpy: MRE in percent; mIoU and MPE as fractions.

Areas are [N] in cm2, true ones positive. Masks are [N, H, W] (or [H, W] for one picture), nonzero where leaf.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def relative_errors(predicted: ArrayLike, true: ArrayLike) -> Floats:
    """|predicted - true| / true per leaf in percent, [N]; ValueError for unlike shapes or areas <= 0."""
    found, truth = np.asarray(predicted, np.float64), np.asarray(true, np.float64)
    if found.shape != truth.shape:
        raise ValueError(f"predicted areas {found.shape} and true areas {truth.shape} differ in shape")
    if not (truth > 0).all():
        raise ValueError("a true area is not positive: it has no relative error")
    return 100.0 * np.abs(found - truth) / truth


def mre(predicted: ArrayLike, true: ArrayLike) -> float:
    """Mean relative error of areas, in percent; NaN for no leaves."""
    return _mean_or_nan(relative_errors(predicted, true))


def median_relative_error(predicted: ArrayLike, true: ArrayLike) -> float:
    """Median relative error of areas, in percent; NaN for no leaves."""
    return relative_error_percentile(predicted, true, 50.0)


def p90_relative_error(predicted: ArrayLike, true: ArrayLike) -> float:
    """The relative error in percent that nine leaves in ten stay below; NaN for no leaves."""
    return relative_error_percentile(predicted, true, 90.0)


def relative_error_percentile(predicted: ArrayLike, true: ArrayLike, rank: float) -> float:
    """The relative error in percent at `rank` 0..100, linearly interpolated; NaN for no leaves."""
    errors = relative_errors(predicted, true)
    return float(np.percentile(errors, rank)) if errors.size else float("nan")


def ious(predicted: ArrayLike, true: ArrayLike) -> Floats:
    """Intersection over union of the leaf, per picture, [N]; 1 where both masks are empty."""
    found, truth = _as_mask_batches(predicted, true)
    union = (found | truth).sum(axis=(1, 2))
    shared = (found & truth).sum(axis=(1, 2))
    return np.where(union > 0, shared / np.maximum(union, 1), 1.0)


def pixel_errors(predicted: ArrayLike, true: ArrayLike) -> Floats:
    """|predicted - true| / true of the count of leaf pixels, per picture, [N]; NaN where no pixel is leaf."""
    found, truth = _as_mask_batches(predicted, true)
    counts = truth.sum(axis=(1, 2)).astype(np.float64)
    off = np.abs(found.sum(axis=(1, 2)) - counts)
    return np.divide(off, counts, out=np.full(counts.shape, np.nan), where=counts > 0)


def miou(predicted: ArrayLike, true: ArrayLike) -> float:
    """Mean over pictures of the leaf's intersection over union, 0..1: each picture counts alike."""
    return _mean_or_nan(ious(predicted, true))


def mpe(predicted: ArrayLike, true: ArrayLike) -> float:
    """Mask pixel error: mean over pictures of the relative error in the count of leaf pixels, a fraction.

    Pictures without a leaf pixel have no relative error and are left out; NaN if none remains.
    """
    errors = pixel_errors(predicted, true)
    return _mean_or_nan(errors[~np.isnan(errors)])


def _as_mask_batches(predicted: ArrayLike, true: ArrayLike) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    found, truth = np.asarray(predicted) != 0, np.asarray(true) != 0
    if found.shape != truth.shape or found.ndim not in (2, 3):
        raise ValueError(f"masks {found.shape} and {truth.shape} are not two alike [N, H, W] or [H, W]")
    return np.reshape(found, (-1, *found.shape[-2:])), np.reshape(truth, (-1, *truth.shape[-2:]))


def _mean_or_nan(values: Floats) -> float:
    return float(values.mean()) if values.size else float("nan")
