"""Petioles in a network's mask: about as wide as its pixels, they appear as chains of faint links."""

from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask
from laesi_tf.estimators.leaf_candidates import LeafCandidate
from laesi_tf.estimators.mask_refinement import PETIOLE_SET
from laesi_tf.estimators.mask_shapes import distance_inside, grow_mask, open_by_distance
from laesi_tf.estimators.parameters import parameter

_LINE_PX = 2
"""Width of the lines that connect links."""


@dataclass(frozen=True, kw_only=True)
class PetioleChainParams:
    """Parameters of the chains that petioles are."""

    faint_probability: float = parameter(0.2, unit="probability", set_on=PETIOLE_SET)
    """Above it a pixel may be a link."""
    raised_probability: float = parameter(0.8, unit="probability", set_on=PETIOLE_SET)
    """That of a link, if the chain begins at a blade: interpolation must not break it."""
    max_gap: float = parameter(7.0, unit="network pixels", set_on=PETIOLE_SET)
    """Gap between two links, or a link and the blade, at most."""
    blade_radius: float = parameter(2.5, unit="network pixels", set_on=PETIOLE_SET)
    """A disc of this radius fits into a blade."""
    rim: int = parameter(2, unit="network pixels", set_on=PETIOLE_SET)
    """Pixels so close to a blade are its rim."""
    max_width: float = parameter(5.0, unit="network pixels", set_on=PETIOLE_SET)
    """Mean width of a chain at most, over its reach from the blade."""
    min_reach: float = parameter(8.0, unit="network pixels", set_on=PETIOLE_SET)
    """A chain reaches at least so far from its blade: teeth and halos do not."""


def find_chain(candidate: LeafCandidate, params: PetioleChainParams) -> Mask | None:
    """Return the chain, bool [h, w] in the network's input, that begins at the candidate's blade, if any."""
    blade = open_by_distance(candidate.component, params.blade_radius)
    probability = candidate.probability
    faint, around = probability >= params.faint_probability, ~grow_mask(blade, params.rim)
    links = faint & around & ~candidate.other_leaves_mask()
    if not blade.any() or not links.any():
        return None
    chains = _connect_links(links, blade | (faint & ~around), params.max_gap)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(chains.astype(np.uint8))
    reach, certainty = np.zeros(count), np.zeros(count)
    np.maximum.at(reach, labels, distance_inside(~blade))
    np.maximum.at(certainty, labels, probability)
    is_petiole = statistics[:, cv2.CC_STAT_AREA] <= params.max_width * reach
    # Printed lines are faint everywhere.
    is_petiole &= (reach >= params.min_reach) & (certainty >= candidate.params.leaf_probability)
    is_petiole[0] = False
    found: Mask = is_petiole[labels]
    return found if found.any() else None


def _connect_links(links: Mask, start: Mask, max_gap: float) -> Mask:
    """Return the `links`, bool [h, w], that can be reached from `start`, and straight lines between them."""
    count, labels = cv2.connectedComponents(links.astype(np.uint8))
    waiting, reached = set(range(1, count)), start.copy()
    while waiting:
        distance, nearest = cv2.distanceTransformWithLabels(
            (~reached).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        # Nearest pixels are numbered in the order of the pixels of zero distance.
        rows, columns = np.nonzero(reached)
        following = {}
        for label in waiting:
            at = np.flatnonzero(labels == label)
            closest = at[distance.ravel()[at].argmin()]
            if distance.ravel()[closest] <= max_gap:
                following[label] = closest
        if not following:
            break
        for label, closest in following.items():
            row, column = np.unravel_index(closest, labels.shape)
            end = nearest[row, column] - 1
            line = np.zeros(labels.shape, np.uint8)
            cv2.line(line, (int(column), int(row)), (int(columns[end]), int(rows[end])), 1, _LINE_PX)
            reached |= (labels == label) | (line > 0)
        waiting -= set(following)
    return reached & ~start
