"""Faults that a repainted leaf may have, at any severity, to test the consistency filter.

A fault replaces the leaf inside its mask; outside, the image stays as it is, as after every repainting. Each
is a function of a `PaintedLeaf` and a severity.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.geometry import pixel_centres
from laesi_tf.inpainting.leaf_frame import LeafFrame, fit_leaf_frame
from laesi_tf.inpainting.paper_fill import fill_with_paper

_BITES = 5


@dataclass(frozen=True, eq=False)
class PaintedLeaf:
    """An image uint8 [H, W, 3] whose leaf is faithful to `mask` [H, W], and random numbers of its own."""

    image: RgbImage
    mask: Mask
    random: np.random.Generator

    @cached_property
    def paper(self) -> RgbImage:
        """The image without the leaf, uint8 [H, W, 3]."""
        return fill_with_paper(self.image, self.mask)

    @cached_property
    def frame(self) -> LeafFrame:
        """The leaf's midline and margins."""
        return fit_leaf_frame(self.mask)


@dataclass(frozen=True, eq=False)
class FaultyImage:
    """A repainted image uint8 [H, W, 3] and the leaf that it shows inside its mask, bool [H, W]."""

    image: RgbImage
    leaf: Mask


def keep(painted: PaintedLeaf, _severity: float) -> FaultyImage:
    """Return the faithful image."""
    return FaultyImage(painted.image, painted.mask)


def shift(painted: PaintedLeaf, severity: float) -> FaultyImage:
    """Move the leaf by `severity` times the square root of its area, in any direction."""
    angle = painted.random.uniform(0, 2 * np.pi)
    distance = severity * np.sqrt(painted.mask.sum())
    return _move_leaf(painted, [_affine(1.0, distance * np.array([np.cos(angle), np.sin(angle)]))])


def shrink(painted: PaintedLeaf, severity: float) -> FaultyImage:
    """Scale the leaf's length and width by 1 - `severity` about its middle."""
    middle = np.argwhere(painted.mask).mean(axis=0)[::-1]
    return _move_leaf(painted, [_affine(1 - severity, severity * middle)])


def double(painted: PaintedLeaf, severity: float) -> FaultyImage:
    """Paint two leaves in the place of one, each of the length 1 - `severity`, one behind the other."""
    frame, scale = painted.frame, 1 - severity
    middle = frame.to_pixels(np.array([[0.5, 0.0]]))[0]
    offset = frame.axis * frame.length * (1 - scale) / 2
    moves = [_affine(scale, middle - scale * middle + sign * offset) for sign in (-1, 1)]
    return _move_leaf(painted, moves)


def bite(painted: PaintedLeaf, severity: float) -> FaultyImage:
    """Bite round pieces off the margin until the share `severity` of the leaf is missing."""
    contours, _ = cv2.findContours(painted.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    margin = np.concatenate(contours)[:, 0]
    centres = margin[painted.random.integers(len(margin), size=_BITES)]
    rows, columns = np.mgrid[: painted.mask.shape[0], : painted.mask.shape[1]]
    distances = [np.hypot(rows - y, columns - x) for x, y in centres]
    nearest = np.min(distances, axis=0)
    radius = np.quantile(nearest[painted.mask], severity)
    return _remove(painted, nearest < radius)


def miss(painted: PaintedLeaf, severity: float) -> FaultyImage:
    """Leave out the share `severity` of the leaf, from its tip; with 1 there is no leaf at all."""
    along = painted.frame.to_leaf(pixel_centres(painted.mask))[:, 0]
    missing = np.zeros_like(painted.mask)
    missing[painted.mask] = along >= np.quantile(along, 1 - severity) if severity < 1 else True
    return _remove(painted, missing)


def fade(painted: PaintedLeaf, severity: float) -> FaultyImage:
    """Blend the leaf's colour with that of the paper by `severity`; with 1 only its texture remains."""
    image = painted.image.astype(np.float32)
    leaf = image[painted.mask].mean(axis=0)
    # Relief without colour: what the texture adds to the mean, half as strong as on the leaf.
    relief = (image - leaf).mean(axis=-1, keepdims=True) * 0.5
    paper = painted.paper[painted.mask].astype(np.float32).mean(axis=0)
    blended = (1 - severity) * image + severity * (paper + relief)
    faded = np.where(painted.mask[..., None], np.clip(np.rint(blended), 0, 255), image).astype(np.uint8)
    return FaultyImage(faded, painted.mask if severity < 1 else np.zeros_like(painted.mask))


@dataclass(frozen=True)
class Fault:
    """A kind of fault, the severities that the benchmark tries, and what they mean."""

    apply: Callable[[PaintedLeaf, float], FaultyImage]
    severities: Sequence[float]
    unit: str


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "faithful": Fault(keep, (0.0,), ""),
        "shifted": Fault(shift, (0.05, 0.1, 0.2, 0.4), "of the leaf's size"),
        "scaled": Fault(shrink, (0.05, 0.1, 0.2, 0.4), "shorter"),
        "bitten": Fault(bite, (0.1, 0.2, 0.3, 0.5), "of the area"),
        "doubled": Fault(double, (0.4, 0.5, 0.6), "shorter, each"),
        "missing": Fault(miss, (0.1, 0.2, 0.5, 1.0), "of the area"),
        "paper's colour": Fault(fade, (0.5, 0.8, 0.9, 1.0), "of the colour"),
    }
)
"""All kinds of faults by name."""


def _affine(scale: float, offset: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix [2, 3] of p -> scale * p + offset for points (x, y) at pixel centres."""
    return np.array([[scale, 0, offset[0]], [0, scale, offset[1]]])


def _move_leaf(painted: PaintedLeaf, moves: Sequence[NDArray[np.float64]]) -> FaultyImage:
    """Return paper with a copy of the leaf for each of `moves`, clipped to the mask."""
    size = painted.mask.shape[::-1]
    result, shown = painted.paper.copy(), np.zeros_like(painted.mask)
    for matrix in moves:
        image = cv2.warpAffine(painted.image, matrix, size, flags=cv2.INTER_LINEAR)
        coverage = cv2.warpAffine(painted.mask.astype(np.float32), matrix, size, flags=cv2.INTER_LINEAR)
        leaf = (coverage > 0.5) & painted.mask
        result[leaf], shown = image[leaf], shown | leaf
    return FaultyImage(np.where(painted.mask[..., None], result, painted.image), shown)


def _remove(painted: PaintedLeaf, missing: Mask) -> FaultyImage:
    """Return the image with paper where the leaf is `missing`."""
    bare = missing & painted.mask
    return FaultyImage(np.where(bare[..., None], painted.paper, painted.image), painted.mask & ~bare)
