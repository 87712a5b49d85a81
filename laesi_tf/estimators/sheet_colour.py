"""Whether a leaf lies on the sheet whose lines were read, by the colour of what surrounds it.

Leaves near an edge of the sheet hide its lines there. And cloth around a scrap of paper may look ruled.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.arrays import FloatMap, Mask, Points, RgbImage
from laesi_tf.estimators.mask_shapes import distance_inside
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, shrink
from laesi_tf.models.ruling_cells import CELL_PX

_SET_ON = "semi-real photos with pasted leaves, rendered (split develop); 2026-11-30"

_ALIKE_SET_ON = (
    "rendered (split develop), semi-real (val), cases, phone scenes of seeds 81, 82 and 90: at least 0.33 "
    "where the scale is right, at most 0.12 where cloth or mesh was read; 2026-12-01"
)


@dataclass(frozen=True, kw_only=True)
class SheetColourParams:
    """Parameters of the comparison of what surrounds a leaf with the ruled part of the sheet."""

    side_px: int = parameter(448, unit="pixels", set_on=_SET_ON)
    """Longer side of the image that is compared."""
    window_px: int = parameter(9, unit="pixels", set_on=_SET_ON)
    """Side of the window in which colours are averaged, over lines of the ruling."""
    ring_px: tuple[int, int] = parameter((5, 13), unit="pixels", set_on=_SET_ON)
    """Distances from the leaf between which its surroundings are seen."""
    near: float = parameter(0.5, unit="leaf sizes (square root of its area)", set_on=_SET_ON)
    """The sheet is seen within this distance, as light falls off; beyond it where it shows none there."""
    max_tint: float = parameter(8.0, unit="CIELAB", set_on=_SET_ON)
    """Largest difference of a* and of b*."""
    max_shade: float = parameter(0.5, unit="ln", set_on=_SET_ON)
    """Largest difference of the lightness."""
    least_share: float = parameter(0.75, unit="share of the surroundings", set_on=_SET_ON)
    """So much of what surrounds a leaf beside the ruled part has the sheet's colour if it is the sheet."""
    least_share_within: float = parameter(
        0.25,
        unit="share of the surroundings",
        set_on="rendered (split develop), semi-real (val) and phone scenes: at least 0.52 where the scale is "
        "right, 0.08 around a scrap of paper on checked cloth that was read as ruling; 2026-11-30",
    )
    """So much of what surrounds a leaf within the ruled part has the sheet's colour if it is the sheet."""
    least_alike: float = parameter(0.25, unit="share of the ruled part", set_on=_ALIKE_SET_ON)
    """So much of the ruled part has the colour of what surrounds a leaf, if the ruling is of its sheet."""
    max_shade_apart: float = parameter(1.0, unit="ln", set_on=_ALIKE_SET_ON)
    """Largest difference of the lightness across the sheet."""


class SheetColour:
    """The colours of a photo with a ruled sheet."""

    def __init__(
        self,
        overview: Crop,
        part: Crop,
        ruled_cells: Mask,
        leaves: Sequence[Points],
        params: SheetColourParams,
    ) -> None:
        """Take a photo's overview, the part of it whose ruling was read, the cells that show the ruling, and
        the outlines of all leaves.

        Cells are bool [C, C], of CELL_PX pixels of `part`; outlines [n, 2] are in photo pixels.
        """
        self._params = params
        self._small = shrink(overview, params.side_px)
        mean = cv2.blur(self._small.image, (params.window_px, params.window_px))
        self._lab = cv2.cvtColor(mean.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
        self._is_bare = distance_inside(self._small.paint(leaves) == 0) > params.ring_px[0]
        # Cells at the border of the ruling show some of what lies beside it.
        inner = cv2.erode(ruled_cells.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        self._is_sheet = _sample(inner, part, self._small) & self._is_bare

    def measure_likeness(self, leaf: Points) -> float:
        """Return the share of what surrounds a leaf that has the colour of the sheet beside it.

        `leaf` [n, 2] is its outline in photo pixels. NaN where too little is seen of either.
        """
        params, is_sheet = self._params, self._is_sheet
        distance, side = self._measure_distance(leaf)
        is_near = is_sheet & (distance < params.near * side + params.ring_px[1])
        ring = self._is_bare & (distance <= params.ring_px[1])
        return self._measure_share(ring, is_near if is_near.any() else is_sheet, params.max_shade)

    def is_mostly_other(self, leaf: Points) -> bool:
        """Return whether most of the ruled part has another colour than what surrounds a leaf, outline
        [n, 2] in photo pixels: cloth or mesh whose pattern was read beside the leaf's own paper."""
        ring = self._is_bare & (self._measure_distance(leaf)[0] <= self._params.ring_px[1])
        share = self._measure_share(self._is_sheet, ring, self._params.max_shade_apart)
        return share < self._params.least_alike

    def _measure_distance(self, leaf: Points) -> tuple[FloatMap, float]:
        """Return the distance [h, w] from a leaf, and the square root of its area."""
        painted = self._small.paint([leaf])
        return distance_inside(painted == 0), math.sqrt(np.count_nonzero(painted))

    def _measure_share(self, part: Mask, other: Mask, max_shade: float) -> float:
        """Return the share of `part` that has the median colour of `other`; NaN where either is empty."""
        if not part.any() or not other.any():
            return math.nan
        expected = np.median(self._lab[other], axis=0)
        tint = np.abs(self._lab[part, 1:] - expected[1:]).max(axis=1)
        shade = np.abs(np.log(np.maximum(self._lab[part, 0], 1) / max(expected[0], 1)))
        return float(((tint < self._params.max_tint) & (shade < max_shade)).mean())


def _sample(cells: Mask, part: Crop, crop: Crop) -> Mask:
    """Return `cells`, bool [C, C], of CELL_PX pixels of `part`, at the pixels of `crop`; False beside it."""
    # From a pixel of `crop` to cells: as one affine map, whose nearest neighbours OpenCV takes.
    step = crop.pixel_size / (part.pixel_size * CELL_PX)
    start = part.from_photo(crop.to_photo(np.full(2, 0.5))) / CELL_PX - 0.5
    to_cells = np.array([[step[0], 0, start[0]], [0, step[1], start[1]]])
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    width, height = crop.size.width, crop.size.height
    return cv2.warpAffine(cells.astype(np.uint8), to_cells, (width, height), flags=flags) > 0


def compare_with_paper(image: RgbImage, paper: Mask) -> tuple[FloatMap, FloatMap]:
    """Return how the colours of `image`, uint8 [h, w, 3], differ from the median of `paper`, bool [h, w].

    The first, [h, w], is the difference of hue and saturation, CIELAB; the second, [h, w], that of ln of
    lightness, negative where the image is darker.
    """
    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    lightness, a, b = np.median(lab[paper], axis=0)
    tint = np.hypot(lab[..., 1] - a, lab[..., 2] - b)
    return tint, np.log(np.maximum(lab[..., 0], 1) / max(float(lightness), 1))
