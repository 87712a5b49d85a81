"""A model of the colours of one leaf and of the paper beside it, fitted to one crop of the photo."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, RgbImage
from laesi_tf.estimators.mask_shapes import distance_inside, make_disc
from laesi_tf.estimators.parameters import parameter

PRIOR_WEIGHT = 0.02
"""Weight of the mean over the whole crop in a local mean, so that it exists everywhere."""
MIN_VARIANCE = 4.0
"""Variance in levels squared that is added to every channel: noise that the samples may not show."""
SHRINKAGE = 0.01
"""Share of the mean variance that is added to every channel, which keeps the scatter invertible."""
_ROUNDS = 3
"""Fits of a thin thing's colour, each on samples that the one before has chosen."""


@dataclass(frozen=True, kw_only=True)
class ColourModelParams:
    """Parameters of the colour model."""

    sure_probability: float = parameter(0.9, unit="probability")
    """Pixels above it are samples of the leaf."""
    faint_probability: float = parameter(0.1, unit="probability")
    """Pixels above it are no samples of the paper."""
    leaf_distance: float = parameter(1.5, unit="network pixels")
    """Distance of leaf samples from the network's outline."""
    paper_distance: float = parameter(1.0, unit="network pixels")
    """Distance of paper samples from faint pixels."""
    local_paper_width: float = parameter(2.0, unit="network pixels")
    """How much farther the paper reaches whose local colour counts: near the leaf, in its shadow."""
    annulus_width: float = parameter(0.2, unit="leaf sizes (square root of its area)")
    """Width of the annulus of paper that the discriminant is fitted to."""
    shades: tuple[float, ...] = parameter(
        (1.0, 0.7, 0.45),
        unit="share of the light",
        set_on="photos with contact shadows: masks were 0.7 % too large without shades, 0.1 % with them; "
        "2026-11-25",
    )
    """Brightness of the copies of the paper samples, so that shadow is not classified as leaf."""
    window: float = parameter(7.0, unit="network pixels")
    """Side of the window in which local colours are averaged."""
    max_log_odds: float = parameter(6.0, unit="log-odds")
    """Bound of the log-odds of a colour."""
    min_samples: int = parameter(30, unit="pixels")
    """Without as many samples of leaf and of paper there is no colour model."""
    max_samples: int = parameter(
        16000, unit="pixels", set_on="all pixels took a tenth of a photo's time, 2026-11-25"
    )
    """About as many samples of each are used to fit the discriminant."""


@dataclass(frozen=True, eq=False)
class ColourModel:
    """Colours of a leaf and its paper."""

    log_odds: FloatMap
    """float32 [h, w], log-odds that a pixel is leaf by its colour."""
    paper_mean: NDArray[np.float32]
    """float32 [3], mean colour of the paper beside the leaf."""
    paper_sd: NDArray[np.float32]
    """float32 [3], its standard deviation, of which the ruling is most."""


def fit_colour_model(
    image: RgbImage,
    probability: FloatMap,
    network_px: float,
    others: Mask | None,
    params: ColourModelParams,
) -> ColourModel | None:
    """Fit the colours of leaf and paper on `image`, uint8 [h, w, 3]; None with too few samples of either.

    `probability`, float32 [h, w], is the network's; one of its pixels is `network_px` pixels wide. `others`,
    bool [h, w], are other leaves. The log-odds are those of two normal distributions of equal variance along
    Fisher's discriminant, whose means are local: they rise linearly and are zero halfway between the means.
    """
    stride = max(1, int(network_px // 2))
    grid = (slice(stride // 2, None, stride),) * 2
    colours, unit = image[grid].astype(np.float32), network_px / stride
    leaf, annulus, near = _select_samples(
        probability[grid], unit, None if others is None else others[grid], params
    )
    if min(np.count_nonzero(leaf), np.count_nonzero(near)) < params.min_samples:
        return None
    log_odds = _discriminate(image, colours, leaf, annulus, near, params.window * unit, params)
    paper = colours[near]
    return ColourModel(log_odds, paper.mean(axis=0), paper.std(axis=0))


def fit_thing_colour(
    image: RgbImage, thing: Mask, paper: Mask, network_px: float, params: ColourModelParams
) -> FloatMap | None:
    """Return the log-odds, float32 [h, w], that pixels of `image` have the colour of a thin thing.

    `thing`, bool [h, w], is about where it is, `paper` is beside it. None with too few samples of either.
    """
    colours = image.astype(np.float32)
    log_odds, sample = None, thing
    for _ in range(_ROUNDS):
        if min(np.count_nonzero(sample), np.count_nonzero(paper)) < params.min_samples:
            return None
        window = params.window * network_px
        log_odds = _discriminate(image, colours, sample, paper, paper, window, params)
        # Samples along the rim were paper.
        sample = thing & (log_odds > 0)
    return log_odds


def _discriminate(
    image: RgbImage,
    colours: NDArray[np.float32],
    leaf: Mask,
    annulus: Mask,
    near: Mask,
    window: float,
    params: ColourModelParams,
) -> FloatMap:
    """Return the log-odds, float32 [H, W], of the colours of `image`.

    `colours` [h, w, 3] are its pixels that the samples are chosen from; `window` is in those pixels.
    """
    shaded_paper = np.concatenate([colours[annulus] * shade for shade in params.shades])
    direction = _fit_discriminant(colours[leaf], shaded_paper, params.max_samples)
    side = int(window) | 1
    values = colours @ direction
    leaf_mean, paper_mean = _local_mean(values, leaf, side), _local_mean(values, near, side)
    variance = (np.var((values - leaf_mean)[leaf]) + np.var((values - paper_mean)[near])) / 2 + 1e-6
    slope = np.maximum(leaf_mean - paper_mean, 0) / variance
    midpoint = (leaf_mean + paper_mean) / 2
    full = image.shape[1::-1]
    score = cv2.transform(image.astype(np.float32), direction[np.newaxis])
    log_odds = (score - cv2.resize(midpoint, full)) * cv2.resize(slope, full)
    bounded: FloatMap = np.clip(log_odds, -params.max_log_odds, params.max_log_odds)
    return bounded


def _select_samples(
    probability: FloatMap, unit: float, others: Mask | None, params: ColourModelParams
) -> tuple[Mask, Mask, Mask]:
    """Return pixels, bool [h, w] each, that are certainly leaf, paper around it, and paper close to it.

    One pixel of the network is `unit` pixels wide.
    """
    sure = (probability > params.sure_probability).astype(np.uint8)
    leaf = cv2.erode(sure, make_disc(params.leaf_distance * unit)) > 0
    core, faint = probability >= 0.5, probability > params.faint_probability
    paper = cv2.dilate(faint.astype(np.uint8), make_disc(params.paper_distance * unit)) == 0
    if others is not None:
        paper &= ~others
    width = max(6 * unit, params.annulus_width * float(np.sqrt(np.count_nonzero(core))))
    annulus = (distance_inside(~core) <= width) & paper
    reach = (params.paper_distance + params.local_paper_width) * unit
    return leaf, annulus, (distance_inside(~faint) <= reach) & paper


def _fit_discriminant(
    leaf: NDArray[np.float32], paper: NDArray[np.float32], max_samples: int
) -> NDArray[np.float32]:
    """Return Fisher's discriminant [3], of unit length, from colours of paper [m, 3] to leaf [n, 3]."""
    leaf, paper = _subsample(leaf, max_samples), _subsample(paper, max_samples)
    scatter = (np.cov(leaf.T) + np.cov(paper.T)) / 2
    scatter += np.eye(3) * (SHRINKAGE * np.trace(scatter) / 3 + MIN_VARIANCE)
    direction = np.linalg.solve(scatter, leaf.mean(axis=0) - paper.mean(axis=0))
    return (direction / (np.linalg.norm(direction) + 1e-9)).astype(np.float32)


def _subsample(colours: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Return about `count` of `colours` [n, 3], evenly spaced."""
    return colours[:: max(1, len(colours) // count)]


def _local_mean(values: FloatMap, mask: Mask, window: int) -> FloatMap:
    """Return the mean of `values` [h, w] over the pixels of `mask` in a window around each pixel."""
    weight = mask.astype(np.float32)
    count = cv2.blur(weight, (window, window)) + PRIOR_WEIGHT
    prior = PRIOR_WEIGHT * float(values[mask].mean())
    return (cv2.blur(values * weight, (window, window)) + prior) / count
