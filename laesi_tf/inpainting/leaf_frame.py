"""Coordinates of a leaf along and across its midline, in which leaves of different shapes correspond.

`along` is 0 at the base of the blade and 1 at its tip, `across` is 0 on the midline and -1 and 1 at the
margins of the smoothed outline: lobes and teeth are smaller than the smoothing, so they cut the texture
instead of bending its veins. The petiole has `along` below 0.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Mask, Points
from laesi_tf.common.geometry import pixel_centres

Profile = NDArray[np.float64]

_STATIONS = 64
"""Cross-sections along the blade."""
_SMOOTHING = 5.0
"""Standard deviation of the smoothing in stations: a twelfth of the blade."""
_PETIOLE_WIDTH = 0.15
"""Parts narrower than this, relative to the square root of the area, are no blade."""
_MIN_PETIOLE = 0.03
"""A petiole is at least so long, relative to the blade; else it is unknown which end is the base."""
_MIN_WIDTH = 0.12
"""Half-widths are at least this share of the largest: at the tips they would become zero."""


@dataclass(frozen=True, eq=False)
class LeafFrame:
    """The midline of a leaf and its smoothed margins, in pixels of its image."""

    origin: Points
    """(x, y) of the base end of the axis."""
    axis: Points
    """Unit vector from the base to the tip."""
    length: float
    """Length of the blade along the axis."""
    centre: Profile
    """[64] offset of the midline from the axis at each station."""
    half_width: Profile
    """[64] half of the blade's smoothed width at each station."""
    has_petiole: bool
    """Whether a petiole says which end is the base."""

    @cached_property
    def width(self) -> float:
        """Largest width of the blade."""
        return float(2 * self.half_width.max())

    @property
    def normal(self) -> Points:
        """Unit vector across the axis."""
        return np.array([-self.axis[1], self.axis[0]])

    def reverse(self) -> "LeafFrame":
        """Return the frame with base and tip exchanged."""
        return LeafFrame(
            self.origin + self.length * self.axis,
            -self.axis,
            self.length,
            -self.centre[::-1],
            self.half_width[::-1],
            self.has_petiole,
        )

    def to_leaf(self, points: Points) -> Points:
        """Map pixels (x, y), [N, 2], to (along, across), [N, 2]."""
        offset = points - self.origin
        along = offset @ self.axis / self.length
        across = (offset @ self.normal - self._at(self.centre, along)) / self._at(self.half_width, along)
        return np.stack([along, across], axis=-1)

    def to_pixels(self, coordinates: Points) -> Points:
        """Map (along, across), [N, 2], to pixels (x, y), [N, 2]."""
        along, across = coordinates.T
        offset = self._at(self.centre, along) + across * self._at(self.half_width, along)
        return self.origin + (along * self.length)[:, None] * self.axis + offset[:, None] * self.normal

    def _at(self, profile: Profile, along: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(along * (_STATIONS - 1), np.arange(_STATIONS), profile)


def fit_leaf_frame(mask: Mask) -> LeafFrame:
    """Fit the frame of the leaf in `mask`, bool [H, W], which is not empty."""
    everything = pixel_centres(mask)
    blade = pixel_centres(_remove_petiole(mask))
    middle = blade.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((blade - middle).T) if len(blade) > 1 else np.eye(2))
    axis = vectors[:, -1]
    positions = (blade - middle) @ axis
    low, high = float(positions.min()) - 0.5, float(positions.max()) + 0.5
    ends = (everything - middle) @ axis
    before, after = low - float(ends.min()), float(ends.max()) - high
    if after > before:
        axis, low, high = -axis, -high, -low
    origin, length = middle + low * axis, high - low
    centre, half_width = _measure_profile(blade, origin, axis, length)
    return LeafFrame(origin, axis, length, centre, half_width, max(before, after) > _MIN_PETIOLE * length)


def compare_shapes(one: LeafFrame, other: LeafFrame) -> float:
    """Return the difference of two leaves in slenderness, width along the midline, and bend; 0 if equal."""
    slenderness = abs(np.log(one.length / one.width) - np.log(other.length / other.width))
    widths = np.abs(one.half_width / one.width - other.half_width / other.width).mean()
    bend = np.abs(one.centre / one.width - other.centre / other.width).mean()
    return float(slenderness + 2 * widths + 2 * bend)


def _remove_petiole(mask: Mask) -> Mask:
    """Return the parts of `mask` that are wide enough for a blade, or all of it if none is."""
    diameter = max(3, round(_PETIOLE_WIDTH * float(np.sqrt(mask.sum()))) | 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter))
    padded = np.pad(mask.astype(np.uint8), diameter)
    blade = cv2.morphologyEx(padded, cv2.MORPH_OPEN, kernel)[diameter:-diameter, diameter:-diameter] > 0
    return blade if blade.any() else mask


def _measure_profile(blade: Points, origin: Points, axis: Points, length: float) -> tuple[Profile, Profile]:
    """Return the midline's offset and the half-width, [64] each, of a blade's pixels [N, 2]."""
    offset = blade - origin
    station = np.clip(offset @ axis / length * _STATIONS, 0, _STATIONS - 1).astype(int)
    across = offset @ np.array([-axis[1], axis[0]])
    left, right = np.full(_STATIONS, np.inf), np.full(_STATIONS, -np.inf)
    np.minimum.at(left, station, across)
    np.maximum.at(right, station, across)
    # A small blade has fewer pixels than stations.
    known = np.isfinite(left)
    stations = np.arange(_STATIONS)
    left, right = (np.interp(stations, stations[known], side[known]) for side in (left, right))
    profile = np.stack([(left + right) / 2, (right - left) / 2 + 0.5])
    smooth = cv2.GaussianBlur(
        profile, (0, 0), sigmaX=_SMOOTHING, sigmaY=1e-3, borderType=cv2.BORDER_REPLICATE
    )
    centre, half_width = smooth
    return centre, np.maximum(half_width, _MIN_WIDTH * half_width.max())
