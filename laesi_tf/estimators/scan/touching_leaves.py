"""Recognise that an outline is that of several leaves which touch: wide parts with a narrow neck between."""

from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.scan.plain_background import DRAWN_SCANS

_SIDE_PX = 160
"""Longer side of the mask that is looked at."""
_STEPS = 24


@dataclass(frozen=True, kw_only=True)
class TouchingLeavesParams:
    """Parameters of the recognition."""

    min_part: float = parameter(0.2, unit="share of the area", set_on=DRAWN_SCANS)
    """Each of the leaves has at least so much; the lobes of a leaf have less."""
    max_neck: float = parameter(0.45, unit="width of the narrower part", set_on=DRAWN_SCANS)
    """The neck is at most so wide."""


def looks_like_several_leaves(mask: Mask, params: TouchingLeavesParams) -> bool:
    """Return whether `mask`, bool [h, w], is that of leaves which touch.

    The mask is eroded more and more: leaves that touch fall apart long before the smaller of them vanishes.
    """
    scale = min(1.0, _SIDE_PX / max(mask.shape))
    size = [max(1, round(side * scale)) for side in mask.shape[::-1]]
    small = cv2.resize(mask.astype(np.uint8) * 255, size, interpolation=cv2.INTER_AREA) >= 128
    padded = np.pad(small, 1).astype(np.uint8)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)
    deepest, total = float(depth.max()), np.count_nonzero(padded)
    for level in np.linspace(0, deepest, _STEPS, endpoint=False)[1:]:
        count, labels = cv2.connectedComponents((depth > level).astype(np.uint8))
        if count < 3:
            continue
        depths = [float(depth[labels == label].max()) for label in range(1, count)]
        # What is left of a part has lost a rim as wide as `level`.
        areas = [_restore_area(labels == label, float(level)) for label in range(1, count)]
        large = [peak for peak, area in zip(depths, areas, strict=True) if area >= params.min_part * total]
        if len(large) >= 2 and level <= params.max_neck * sorted(large)[-2]:
            return True
    return False


def _restore_area(part: Mask, level: float) -> int:
    """Return the number of pixels of `part` after dilation by `level` pixels."""
    distance = cv2.distanceTransform((~part).astype(np.uint8), cv2.DIST_L2, 5)
    return int(np.count_nonzero(distance <= level))
