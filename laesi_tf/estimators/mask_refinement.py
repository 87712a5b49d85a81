"""The margin of a leaf at a photo's own resolution; the network that found the leaf sees few pixels of it.

Inside a band about the network's outline each pixel is decided by its colour and by the network together: the
log-odds of the colour, from a linear discriminant between leaf and paper, are added to the network's own.
Where the two colours hardly differ the first are near zero and the outline stays the network's. Beyond the
band thin leaf-coloured pieces that hang on the leaf are followed: petioles, which the network is too coarse
for.
"""

from dataclasses import dataclass

import cv2
import numpy as np

_BAND = 3.0
"""Half the width of the band, in pixels of the network."""
_SURE, _FAINT = 0.9, 0.1
"""Probability above which a pixel's colour stands for the leaf, and above which it cannot stand for the
paper."""
_INSIDE, _BESIDE, _NEAR = 1.5, 1.0, 2.0
"""Distances in pixels of the network: of leaf samples from the outline; of paper samples from it; and how
much further the paper reaches whose local colour counts, close by as it lies in the leaf's own shadow."""
_RING = 0.2
"""Width of the ring of paper that the discriminant learns from, in units of the leaf's size."""
_SHADES = 1.0, 0.7, 0.45
"""Paper is shown to the discriminant in its own light and darkened so, that a shadow is not taken for leaf.

Without it silhouettes were 0.7 % too large on photographs with contact shadows, with it 0.1 %.
"""
_WINDOW = 7.0
"""Side of the window that local colours are averaged over, in pixels of the network."""
_COLOUR_MOST, _NETWORK_MOST, _NETWORK_WEIGHT = 6.0, 3.0, 0.7
"""Bounds of both log-odds, and the weight of the network's, which is trained to be sure of itself."""
_REACH, _THICKEST, _LEAF_COLOURED = 0.3, 0.16, 3.5
"""Petioles: how far they are followed, in lengths of the leaf; their width at most, in units of its size; the
log-odds of their colour."""
_RULED, _GREENER, _BRIGHTER = 1 / 3, 1.12, 1.3
"""Holes: how much their colours vary at least, how much greener and how much brighter they are at most,
against the paper beside the leaf."""
_SPUR = 0.3
"""What sticks out of the network's outline and is thinner than twice this, in its pixels, is ink."""
_FEWEST, _ENOUGH = 30, 16000
"""Samples of leaf and paper without which the network's outline stands, and how many tell their colours."""


@dataclass(frozen=True, eq=False)
class RefinedMask:
    """A leaf in a cut of a photo: `mask`, bool [h, w], and how much of its area is in doubt."""

    mask: np.ndarray
    doubt_px: float
    """Pixels that could as well be judged otherwise, each counted by the probability of that."""


def refine_mask(
    image: np.ndarray, probability: np.ndarray, coarseness: float, others: np.ndarray | None = None
) -> RefinedMask:
    """Outline the leaf on `image`, uint8 [h, w, 3], that a network sees with `probability`, float32 [h, w].

    One pixel of the network is `coarseness` pixels of the image. `others`, bool [h, w], are neither this leaf
    nor its paper.
    """
    seen = _fit_colour_model(image, probability, coarseness, others)
    core = probability >= 0.5
    if seen is None:
        return RefinedMask(core, _expected_errors_px(_logit(probability)))
    odds = seen.odds
    total = odds + np.clip(_NETWORK_WEIGHT * _logit(probability), -_NETWORK_MOST, _NETWORK_MOST)
    depth, distance = _distance_inside(core), _distance_inside(~core)
    total[depth > _BAND * coarseness] = _COLOUR_MOST
    total[distance > _BAND * coarseness] = -_COLOUR_MOST
    leaf = total > 0
    if others is not None:
        leaf &= ~others
    mask = _fill_glossy_holes(_add_petiole(leaf, core, odds, distance, coarseness), image, seen)
    return RefinedMask(mask if mask.any() else core, _expected_errors_px(total))


@dataclass(frozen=True, eq=False)
class ColourModel:
    """What colours tell: the log-odds `odds`, float32 [h, w], that a pixel is leaf, and the mean and standard
    deviation [3] of the `paper` beside it."""

    odds: np.ndarray
    paper: np.ndarray
    spread: np.ndarray


def _fit_colour_model(
    image: np.ndarray, probability: np.ndarray, coarseness: float, others: np.ndarray | None
) -> ColourModel | None:
    """The colours of leaf and paper; None with too little of either."""
    stride = max(1, int(coarseness // 2))
    every = (slice(stride // 2, None, stride),) * 2
    colours, unit = image[every].astype(np.float32), coarseness / stride
    leaf, ring, near = _select_samples(probability[every], unit, None if others is None else others[every])
    if min(np.count_nonzero(leaf), np.count_nonzero(near)) < _FEWEST:
        return None
    direction = _fit_discriminant(colours[leaf], np.concatenate([colours[ring] * shade for shade in _SHADES]))
    window = int(_WINDOW * unit) | 1
    of_leaf = _local_mean(colours @ direction, leaf, window)
    of_paper = _local_mean(colours @ direction, near, window)
    values = colours @ direction
    variance = (np.var((values - of_leaf)[leaf]) + np.var((values - of_paper)[near])) / 2 + 1e-6
    # Two normal distributions of one variance: the log-odds rise linearly and are zero midway.
    slope = np.maximum(of_leaf - of_paper, 0) / variance
    middle = (of_leaf + of_paper) / 2
    full = image.shape[1::-1]
    score = cv2.transform(image.astype(np.float32), direction[np.newaxis])
    odds = (score - cv2.resize(middle, full)) * cv2.resize(slope, full)
    beside = colours[near]
    return ColourModel(np.clip(odds, -_COLOUR_MOST, _COLOUR_MOST), beside.mean(axis=0), beside.std(axis=0))


def _select_samples(
    probability: np.ndarray, unit: float, others: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels, bool [h, w] each, that are surely leaf, surely paper around it, and the paper beside it."""
    leaf = cv2.erode((probability > _SURE).astype(np.uint8), _disc(_INSIDE * unit)) > 0
    core, faint = (probability >= 0.5).astype(np.uint8), (probability > _FAINT).astype(np.uint8)
    beside = cv2.dilate(faint, _disc(_BESIDE * unit)) > 0
    width = max(6 * unit, _RING * float(np.sqrt(np.count_nonzero(core))))
    paper = ~beside if others is None else ~beside & ~others
    ring = (_distance_inside(core == 0) <= width) & paper
    near = (_distance_inside(faint == 0) <= (_BESIDE + _NEAR) * unit) & paper
    return leaf, ring, near


def _fit_discriminant(leaf: np.ndarray, paper: np.ndarray) -> np.ndarray:
    """Fisher's direction [3], of unit length, from colours of paper [m, 3] to those of leaf [n, 3]."""
    leaf, paper = _subsample(leaf), _subsample(paper)
    scatter = (np.cov(leaf.T) + np.cov(paper.T)) / 2
    # Some levels of noise in each channel, whatever the samples happen to show.
    scatter += np.eye(3) * (0.01 * np.trace(scatter) / 3 + 4.0)
    direction = np.linalg.solve(scatter, leaf.mean(axis=0) - paper.mean(axis=0))
    return (direction / (np.linalg.norm(direction) + 1e-9)).astype(np.float32)


def _subsample(colours: np.ndarray) -> np.ndarray:
    """About `_ENOUGH` of `colours` [n, 3]: the statistics of all took a tenth of the time of a photo."""
    return colours[:: max(1, len(colours) // _ENOUGH)]


def _local_mean(values: np.ndarray, where: np.ndarray, window: int) -> np.ndarray:
    """Mean of `values` [h, w] over pixels `where` in a window about each; over all of them where none is."""
    weight = where.astype(np.float32)
    count = cv2.blur(weight, (window, window)) + 0.02
    return (cv2.blur(values * weight, (window, window)) + 0.02 * float(values[where].mean())) / count


def _add_petiole(
    leaf: np.ndarray, core: np.ndarray, odds: np.ndarray, distance: np.ndarray, coarseness: float
) -> np.ndarray:
    """`leaf` with the thin leaf-coloured pieces that hang on it and without spurs of ink and loose pieces."""
    _, _, width, height = cv2.boundingRect(core.astype(np.uint8))
    reach = _REACH * float(np.hypot(width, height))
    followed = leaf | ((odds > _LEAF_COLOURED) & (distance > 0) & (distance <= reach))
    sturdy = cv2.morphologyEx(followed.astype(np.uint8), cv2.MORPH_OPEN, _disc(_SPUR * coarseness)) > 0
    mask = (core & leaf) | sturdy
    mask &= leaf | _find_petiole(mask & ~leaf, distance, reach, core)
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    mine = np.bincount(labels[core & mask], minlength=2)
    mine[0] = 0
    return (labels == mine.argmax()) & mask


def _fill_glossy_holes(mask: np.ndarray, image: np.ndarray, seen: ColourModel) -> np.ndarray:
    """`mask` with those of its holes closed that do not show the paper: a leaf that shines is pale, too."""
    count, labels, statistics, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    closed = mask.copy()
    for label in range(1, count):
        left, top, width, height, _ = statistics[label]
        box = slice(top, top + height), slice(left, left + width)
        inside = labels[box] == label
        at_border = left == 0 or top == 0 or left + width == mask.shape[1] or top + height == mask.shape[0]
        if not at_border and not _looks_like_paper(image[box][inside].astype(np.float32), seen):
            closed[box] |= inside
    return closed


def _looks_like_paper(colours: np.ndarray, seen: ColourModel) -> bool:
    """Whether `colours` [n, 3] are the paper's: in shade perhaps, but neither greener nor far brighter, and
    ruled like it."""
    red, green, blue = colours.mean(axis=0) / np.maximum(seen.paper, 1)
    ruled = colours.std(axis=0).mean() >= _RULED * seen.spread.mean()
    return bool(ruled and green <= _GREENER * np.sqrt(red * blue) and green <= _BRIGHTER)


def _find_petiole(beyond: np.ndarray, distance: np.ndarray, reach: float, core: np.ndarray) -> np.ndarray:
    """The one piece of `beyond`, bool [h, w], that may be a petiole: the largest that is thin and comes to an
    end.

    Lines of a bold ruling run on to where they are no longer followed, or to the border of the view.
    """
    beyond = beyond & ~_thick(beyond, max(1.5, _THICKEST / 2 * float(np.sqrt(np.count_nonzero(core)))))
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(beyond.astype(np.uint8))
    endless = beyond & (distance > reach - 2)
    endless[[0, -1]] = beyond[[0, -1]]
    endless[:, [0, -1]] = beyond[:, [0, -1]]
    size = statistics[:, cv2.CC_STAT_AREA].copy()
    size[np.unique(labels[endless])] = 0
    size[0] = 0
    return (labels == size.argmax()) & beyond & (size.max() > 0)


def _thick(mask: np.ndarray, radius: float) -> np.ndarray:
    """The parts of `mask`, bool [h, w], that a disc of `radius` pixels fits into."""
    middles = _distance_inside(mask) > radius
    return _distance_inside(~middles) <= radius if middles.any() else middles


def _logit(probability: np.ndarray) -> np.ndarray:
    bounded = np.clip(probability, 1e-4, 1 - 1e-4)
    return np.log(bounded / (1 - bounded))


def _expected_errors_px(odds: np.ndarray) -> float:
    return float((1 / (1 + np.exp(np.abs(odds[np.abs(odds) < _COLOUR_MOST])))).sum())


def _distance_inside(of: np.ndarray) -> np.ndarray:
    """Distance of each pixel that is `of`, bool [h, w], from the nearest that is not."""
    return cv2.distanceTransform(of.astype(np.uint8), cv2.DIST_L2, 3)


def _disc(radius: float) -> np.ndarray:
    side = 2 * max(1, round(radius)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
