"""What lies around a leaf: paper, in light or shadow, or something else that may cover a part of the leaf.

Nothing inside an outline tells that a leaf continues below a label or a finger. But what covers it touches
its outline and seldom has the colour of the paper. A margin of the leaf that was left out is seen as well.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.estimators.mask_shapes import distance_inside
from laesi_tf.estimators.parameters import parameter

DARKEST_LEVEL = 4.0
"""Levels below it are noise, whose logarithms have no meaning."""


@dataclass(frozen=True, kw_only=True)
class SurroundingsParams:
    """Parameters of the comparison of what touches a leaf with what lies around it."""

    touching_from: float = parameter(1.0, unit="network pixels")
    """Distance from the outline from which a pixel touches it; closer ones have the leaf's colour, too."""
    touching_to: float = parameter(3.5, unit="network pixels")
    """The same, at most."""
    around_to: float = parameter(14.0, unit="network pixels")
    """Distance from the outline within which most of what is seen is paper."""
    window: float = parameter(2.0, unit="network pixels")
    """Side of the window in which colours are averaged, over lines of the ruling."""
    max_tint: float = parameter(
        0.15, unit="ln", set_on="rendered (split develop), semi-real and phone scenes, 2026-11-29"
    )
    """Difference from the paper's hue: of the logarithms of red, green and blue, without their mean."""
    max_brightening: float = parameter(0.25, unit="ln", set_on="as max_tint")
    """Paper is at most so much brighter beside a leaf than around it."""
    max_shade: float = parameter(1.6, unit="ln", set_on="as max_tint")
    """It is at most so much darker, in shadow."""
    max_share: float = parameter(0.1, unit="share of the outline", set_on="as max_tint")
    """Something else touches at most so much of the outline."""
    min_samples: int = parameter(30, unit="pixels")
    """With fewer pixels beside or around the leaf, nothing is said."""


def is_touched(
    image: RgbImage, leaf: Mask, others: Mask, network_px: float, params: SurroundingsParams
) -> bool:
    """Return whether something other than paper touches a leaf on `image`, uint8 [h, w, 3].

    `leaf` and `others`, other leaves, are bool [h, w]; a pixel of the network is `network_px` wide.
    """
    stride = max(1, int(network_px // 2))
    grid = (slice(stride // 2, None, stride),) * 2
    unit, outside = network_px / stride, ~leaf[grid]
    distance = distance_inside(outside)
    side = int(params.window * unit) | 1
    weight = cv2.blur(outside.astype(np.float32), (side, side))
    colours = cv2.blur(image[grid].astype(np.float32) * outside[..., None], (side, side))
    seen = ~others[grid] & (weight > 1 / 3)
    touching = seen & (distance > params.touching_from * unit) & (distance <= params.touching_to * unit)
    around = seen & (distance > params.touching_to * unit) & (distance <= params.around_to * unit)
    if min(np.count_nonzero(touching), np.count_nonzero(around)) < params.min_samples:
        return False
    levels = np.log(np.maximum(colours / np.maximum(weight, 1 / 3)[..., None], DARKEST_LEVEL))
    difference = levels[touching] - np.median(levels[around], axis=0)
    brightness = difference.mean(axis=1)
    tint = np.linalg.norm(difference - brightness[:, None], axis=1)
    is_other = (
        (tint > params.max_tint) | (brightness > params.max_brightening) | (brightness < -params.max_shade)
    )
    return bool(is_other.mean() > params.max_share)
