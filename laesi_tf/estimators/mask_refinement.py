"""Refine a leaf's mask to the photo's resolution, from a network that sees far fewer pixels.

Inside a band around the network's outline each pixel is classified by its colour and by the network: the
log-odds of the colour model are added to the network's own. Where leaf and paper have almost the same colour
the former are near zero and the network's outline remains. Beyond the band thin leaf-coloured components that
are connected to the leaf are added: petioles, which the network is too coarse for.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, RgbImage
from laesi_tf.estimators.colour_model import (
    ColourModel,
    ColourModelParams,
    fit_colour_model,
    fit_thing_colour,
)
from laesi_tf.estimators.mask_shapes import distance_inside, make_disc, open_by_distance
from laesi_tf.estimators.parameters import parameter

PETIOLE_SET = "phone scenes (1,024 px, seed 80), rendered (split develop) and semi-real (val), 2026-11-30"
"""What the parameters of petioles were set on."""


@dataclass(frozen=True, kw_only=True)
class MaskRefinementParams:
    """Parameters of the refinement of masks."""

    colour: ColourModelParams = field(default_factory=ColourModelParams)
    band: float = parameter(3.0, unit="network pixels")
    """Half the width of the band in which pixels are classified."""
    network_weight: float = parameter(0.7, unit="1")
    """Weight of the network's log-odds: its training makes it overconfident."""
    network_max_log_odds: float = parameter(3.0, unit="log-odds")
    """Bound of the network's weighted log-odds."""
    petiole_reach: float = parameter(0.3, unit="leaf lengths")
    """How far from the blade petioles are followed."""
    petiole_max_width: float = parameter(0.16, unit="leaf sizes (square root of its area)")
    """Width of a petiole at most."""
    petiole_log_odds: float = parameter(3.5, unit="log-odds")
    """Log-odds of a petiole's colour at least."""
    petiole_likeness: float = parameter(0.5, unit="share of its pixels", set_on=PETIOLE_SET)
    """Where more of a petiole has the blade's colour, it has no colour of its own."""
    petiole_paper: float = parameter(6.0, unit="network pixels", set_on=PETIOLE_SET)
    """Paper up to this distance is beside it."""
    hole_min_contrast: float = parameter(
        1 / 3, unit="standard deviation of the paper's colour", set_on="photos of glossy leaves, 2026-11-25"
    )
    """A hole shows the ruling: its colour varies at least so much."""
    hole_max_green: float = parameter(
        1.12,
        unit="green over red and blue, relative to the paper",
        set_on="photos of glossy leaves, 2026-11-25",
    )
    """A hole is at most so much greener than the paper."""
    hole_max_brightness: float = parameter(
        1.3, unit="paper's brightness", set_on="photos of glossy leaves, 2026-11-25"
    )
    """A hole is at most so bright."""
    min_spur_radius: float = parameter(0.3, unit="network pixels")
    """What protrudes from the network's outline and is thinner than twice this is ink."""


@dataclass(frozen=True, eq=False)
class RefinedMask:
    """A leaf in a crop of a photo."""

    mask: Mask
    """bool [h, w]."""
    expected_errors_px: float
    """Expected number of misclassified pixels: the sum of the probabilities of the less likely class."""


def refine_mask(
    image: RgbImage,
    probability: FloatMap,
    network_px: float,
    *,
    others: Mask | None = None,
    petiole: Mask | None = None,
    params: MaskRefinementParams | None = None,
) -> RefinedMask:
    """Refine the mask of the leaf that a network predicts on `image`, uint8 [h, w, 3].

    `probability` is the network's, float32 [h, w], interpolated to the image; one pixel of the network is
    `network_px` pixels wide. `others`, bool [h, w], are neither this leaf nor its paper; `petiole`, bool
    [h, w], is about where the network sees one.
    """
    params = params or MaskRefinementParams()
    core = probability >= 0.5
    network = _logit(probability)
    colours = fit_colour_model(image, probability, network_px, others, params.colour)
    bound = params.colour.max_log_odds
    if colours is None:
        return RefinedMask(core, _count_expected_errors(network, bound))
    of_colour = colours.log_odds
    if petiole is not None:
        of_colour = _classify_petiole(image, core, petiole, of_colour, network_px, params)
    weighted = params.network_weight * network
    log_odds = of_colour + np.clip(weighted, -params.network_max_log_odds, params.network_max_log_odds)
    distance = distance_inside(~core)
    band = params.band * network_px
    log_odds[distance_inside(core) > band] = bound
    log_odds[distance > band] = -bound
    leaf = log_odds > 0
    if others is not None:
        leaf &= ~others
    mask = _add_petiole(leaf, core, colours.log_odds, distance, network_px, params)
    mask = _fill_glossy_holes(mask, image, colours, params)
    return RefinedMask(mask if mask.any() else core, _count_expected_errors(log_odds, bound))


def _classify_petiole(
    image: RgbImage,
    core: Mask,
    petiole: Mask,
    log_odds: FloatMap,
    network_px: float,
    params: MaskRefinementParams,
) -> FloatMap:
    """Return `log_odds` [h, w] with those along `petiole`, bool [h, w], by a colour of its own.

    Petioles often have another colour than the blade: red, brown, or pale.
    """
    if (log_odds[petiole] > 0).mean() > params.petiole_likeness:
        return log_odds
    distance = distance_inside(~petiole)
    paper = (distance > 2 * network_px) & (distance <= params.petiole_paper * network_px)
    paper &= distance_inside(~core) > 2 * network_px
    own = fit_thing_colour(image, petiole, paper, network_px, params.colour)
    if own is None:
        return log_odds
    # It begins inside the blade.
    along = (distance <= network_px) | (core & (distance <= params.petiole_paper * network_px))
    return np.where(along, np.maximum(log_odds, own), log_odds)


def _add_petiole(
    leaf: Mask,
    core: Mask,
    log_odds: FloatMap,
    distance: FloatMap,
    network_px: float,
    params: MaskRefinementParams,
) -> Mask:
    """Return `leaf`, bool [h, w], with its petiole, without thin spurs of ink and unconnected components.

    `core` is the network's mask, `distance` that of each pixel from it.
    """
    _, _, width, height = cv2.boundingRect(core.astype(np.uint8))
    reach = params.petiole_reach * float(np.hypot(width, height))
    max_radius = params.petiole_max_width / 2 * float(np.sqrt(np.count_nonzero(core)))
    followed = leaf | ((log_odds > params.petiole_log_odds) & (distance > 0) & (distance <= reach))
    disc = make_disc(params.min_spur_radius * network_px)
    sturdy = cv2.morphologyEx(followed.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0
    mask = (core & leaf) | sturdy
    mask &= leaf | _find_petiole(mask & ~leaf, distance, reach, max(1.5, max_radius))
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    counts = np.bincount(labels[core & mask], minlength=2)
    counts[0] = 0
    return (labels == counts.argmax()) & mask


def _find_petiole(beyond: Mask, distance: FloatMap, reach: float, max_radius: float) -> Mask:
    """Return the component of `beyond`, bool [h, w], that may be a petiole: the largest thin one that ends.

    Lines of a bold ruling do not end: they continue to where they are no longer followed, or to the border
    of the crop.
    """
    beyond = beyond & ~open_by_distance(beyond, max_radius)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(beyond.astype(np.uint8))
    is_endless = beyond & (distance > reach - 2)
    is_endless[[0, -1]] = beyond[[0, -1]]
    is_endless[:, [0, -1]] = beyond[:, [0, -1]]
    areas = statistics[:, cv2.CC_STAT_AREA].copy()
    areas[np.unique(labels[is_endless])] = 0
    areas[0] = 0
    return (labels == areas.argmax()) & beyond & (areas.max() > 0)


def _fill_glossy_holes(
    mask: Mask, image: RgbImage, colours: ColourModel, params: MaskRefinementParams
) -> Mask:
    """Fill the holes of `mask`, bool [h, w], that do not show paper: gloss on a leaf is pale, too."""
    count, labels, statistics, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    filled = mask.copy()
    for label in range(1, count):
        left, top, width, height, _ = statistics[label]
        box = slice(top, top + height), slice(left, left + width)
        hole = labels[box] == label
        at_border = left == 0 or top == 0 or left + width == mask.shape[1] or top + height == mask.shape[0]
        if not at_border and not _looks_like_paper(image[box][hole].astype(np.float32), colours, params):
            filled[box] |= hole
    return filled


def _looks_like_paper(hole: NDArray[np.float32], colours: ColourModel, params: MaskRefinementParams) -> bool:
    """Return whether the colours `hole` [n, 3] are the paper's, perhaps in shadow.

    They show the ruling and are neither greener nor much brighter.
    """
    red, green, blue = hole.mean(axis=0) / np.maximum(colours.paper_mean, 1)
    shows_ruling = hole.std(axis=0).mean() >= params.hole_min_contrast * colours.paper_sd.mean()
    is_green = green > params.hole_max_green * np.sqrt(red * blue)
    return bool(shows_ruling and not is_green and green <= params.hole_max_brightness)


def _logit(probability: FloatMap) -> FloatMap:
    bounded = np.clip(probability, 1e-4, 1 - 1e-4)
    return np.log(bounded / (1 - bounded))


def _count_expected_errors(log_odds: FloatMap, bound: float) -> float:
    """Return the expected number of misclassified pixels where `log_odds` [h, w] are within the bound."""
    uncertain = np.abs(log_odds[np.abs(log_odds) < bound])
    return float((1 / (1 + np.exp(uncertain))).sum())
