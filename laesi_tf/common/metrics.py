"""The paper's metrics in NumPy: MRE in percent; mIoU and MPE as fractions.

Areas are [N] in cm2, true ones positive. Masks are [N, H, W] (or [H, W] for one image), nonzero where leaf.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def relative_errors(predicted: ArrayLike, true: ArrayLike) -> Floats:
    """Return |predicted - true| / true per leaf in percent, [N].

    Raises ValueError for unequal shapes and for true areas that are not positive.
    """
    found, truth = np.asarray(predicted, np.float64), np.asarray(true, np.float64)
    if found.shape != truth.shape:
        raise ValueError(f"predicted areas {found.shape} and true areas {truth.shape} differ in shape")
    if not (truth > 0).all():
        raise ValueError("a true area is not positive: it has no relative error")
    return 100.0 * np.abs(found - truth) / truth


def mre(predicted: ArrayLike, true: ArrayLike) -> float:
    """Return the mean relative error of areas, in percent; NaN for no leaves."""
    return _mean_or_nan(relative_errors(predicted, true))


def median_relative_error(predicted: ArrayLike, true: ArrayLike) -> float:
    """Return the median relative error of areas, in percent; NaN for no leaves."""
    return relative_error_percentile(predicted, true, 50.0)


def p90_relative_error(predicted: ArrayLike, true: ArrayLike) -> float:
    """Return the 90th percentile of the relative error, in percent; NaN for no leaves."""
    return relative_error_percentile(predicted, true, 90.0)


def relative_error_percentile(predicted: ArrayLike, true: ArrayLike, rank: float) -> float:
    """Return the percentile `rank` (0..100) of the relative error, in percent; NaN for no leaves.

    Between two leaves it is interpolated linearly.
    """
    errors = relative_errors(predicted, true)
    return float(np.percentile(errors, rank)) if errors.size else float("nan")


def ious(predicted: ArrayLike, true: ArrayLike) -> Floats:
    """Return the intersection over union of the leaf per image, [N]; 1 where both masks are empty."""
    found, truth = _as_mask_batches(predicted, true)
    union = (found | truth).sum(axis=(1, 2))
    shared = (found & truth).sum(axis=(1, 2))
    return np.where(union > 0, shared / np.maximum(union, 1), 1.0)


def pixel_errors(predicted: ArrayLike, true: ArrayLike) -> Floats:
    """Return |predicted - true| / true of the number of leaf pixels per image, [N]; NaN where true is 0."""
    found, truth = _as_mask_batches(predicted, true)
    counts = truth.sum(axis=(1, 2)).astype(np.float64)
    off = np.abs(found.sum(axis=(1, 2)) - counts)
    return np.divide(off, counts, out=np.full(counts.shape, np.nan), where=counts > 0)


def miou(predicted: ArrayLike, true: ArrayLike) -> float:
    """Return the mean over images of the leaf's intersection over union, 0..1."""
    return _mean_or_nan(ious(predicted, true))


def mpe(predicted: ArrayLike, true: ArrayLike) -> float:
    """Return the mask pixel error: the mean relative error in the number of leaf pixels, a fraction.

    Images without a leaf pixel have no relative error and are left out; NaN if none remains.
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
