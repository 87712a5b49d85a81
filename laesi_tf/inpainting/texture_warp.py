"""Warp the texture of a donor's leaf onto a mask, along the midlines of both leaves."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, Points, RgbImage
from laesi_tf.common.geometry import pixel_centres
from laesi_tf.inpainting.donor_leaves import Donor
from laesi_tf.inpainting.leaf_frame import LeafFrame, compare_shapes

_LIGHT_EXPONENT = 0.7
"""How far the brightness of a donor follows that of the paper: dark paper may be dark, or in little light."""
_GAIN_LIMITS = 0.45, 1.5
_MAX_SLOPE = 0.6
"""Largest change of the light across the leaf, as a logarithm."""


@dataclass(frozen=True, eq=False)
class Warp:
    """A donor's texture on a target."""

    colour: FloatMap
    """float32 [H, W, 3], 0..255."""
    is_leaf: Mask
    """[H, W], where the donor has leaf."""
    mean_colour: FloatMap
    """float32 [3], of the donor's leaf."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A donor, its frame as it is placed on the target, and whether it is mirrored at its midline."""

    donor: Donor
    frame: LeafFrame
    is_mirrored: bool


def align_best(target: LeafFrame, donors: list[Donor]) -> Alignment:
    """Return the donor of the shape closest to `target`, mirrored or not, reversed if its base is unknown."""
    choices = []
    for number, donor in enumerate(donors):
        frames = [donor.frame]
        if not (donor.frame.has_petiole and target.has_petiole):
            frames.append(donor.frame.reverse())
        for order, frame in enumerate(frames):
            for is_mirrored in (False, True):
                placed = _mirror_shape(frame) if is_mirrored else frame
                cost = compare_shapes(target, placed)
                choices.append((cost, number, order, is_mirrored, frame))
    _, number, _, is_mirrored, frame = min(choices, key=lambda choice: choice[:4])
    return Alignment(donors[number], frame, is_mirrored)


def warp_texture(
    alignment: Alignment, target: LeafFrame, mask: Mask, *, shift: tuple[float, float] = (0.0, 0.0)
) -> Warp:
    """Warp the donor's photo onto the pixels of `mask` [H, W], whose leaf has the frame `target`.

    `shift` moves the texture along and across, in units of the frame. Elsewhere the result is 0 and False.
    """
    donor, frame = alignment.donor, alignment.frame
    # Shrinking first avoids aliasing: veins would break up into dots.
    scale = min(1.0, target.length / frame.length)
    image, leaf = donor.image, donor.leaf.astype(np.float32)
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        leaf = cv2.resize(leaf, image.shape[1::-1], interpolation=cv2.INTER_AREA)
    ratio = np.array(image.shape[1::-1]) / np.array(donor.image.shape[1::-1])
    coordinates = target.to_leaf(pixel_centres(mask)) - shift
    if alignment.is_mirrored:
        coordinates = coordinates * [1, -1]
    points = frame.to_pixels(coordinates) * ratio
    colour = np.zeros((*mask.shape, 3), np.float32)
    is_leaf = np.zeros(mask.shape, bool)
    colour[mask] = _sample(image.astype(np.float32), points)
    is_leaf[mask] = _sample(leaf, points, outside=0.0) > 0.9
    return Warp(colour, is_leaf, donor.image[donor.leaf].mean(axis=0, dtype=np.float32))


def fill_gaps(warp: Warp, mask: Mask) -> FloatMap:
    """Return the texture [H, W, 3] with the pixels of `mask` where the donor has no leaf filled from it.

    A gap mirrors the texture at the donor's margin, so that it has the same grain as the leaf beside it. A
    leaf of a few pixels gets the donor's mean colour.
    """
    if not warp.is_leaf.any():
        return np.broadcast_to(warp.mean_colour, warp.colour.shape)
    _, labels = cv2.distanceTransformWithLabels(
        (~warp.is_leaf).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest = np.zeros((labels.max() + 1, 2), np.intp)
    nearest[labels[warp.is_leaf]] = np.argwhere(warp.is_leaf)
    gaps = np.argwhere(mask & ~warp.is_leaf)
    edge = nearest[labels[gaps[:, 0], gaps[:, 1]]]
    mirrored = np.clip(2 * edge - gaps, 0, np.array(mask.shape) - 1)
    is_inside = warp.is_leaf[mirrored[:, 0], mirrored[:, 1]]
    source = np.where(is_inside[:, None], mirrored, edge)
    filled = warp.colour.copy()
    filled[gaps[:, 0], gaps[:, 1]] = warp.colour[source[:, 0], source[:, 1]]
    return filled


def match_light(texture: FloatMap, donor: Donor, image: RgbImage, mask: Mask) -> FloatMap:
    """Return `texture` [H, W, 3], 0..255, in the light of `image` [H, W, 3], as the paper shows it.

    The brightness follows that of the paper beside the leaf on both photos, and falls off across the leaf as
    the paper around it does.
    """
    around = _paper_around(mask)
    if not around.any():
        return texture
    luma = image.astype(np.float32).mean(axis=-1)
    gain = (np.median(luma[around]) / max(1.0, float(donor.paper.mean()))) ** _LIGHT_EXPONENT
    slope = _fit_light(luma, around, mask)
    return np.clip(texture * np.float32(np.clip(gain, *_GAIN_LIMITS)) * slope[..., None], 0, 255)


def _fit_light(luma: FloatMap, around: Mask, mask: Mask) -> FloatMap:
    """Return the light [H, W] relative to its mean on the leaf: a plane fitted to the paper's logarithm."""
    rows, columns = np.mgrid[: mask.shape[0], : mask.shape[1]]
    middle, side = np.argwhere(mask).mean(axis=0), float(np.sqrt(mask.sum()))
    terms = np.stack([(rows - middle[0]) / side, (columns - middle[1]) / side, np.ones(mask.shape)], -1)
    known, values = terms[around], np.log(luma[around] + 1)
    keep = np.abs(values - np.median(values)) < 0.5
    # Printed lines and notes are dark; what is far from the first fit is not paper.
    for _ in range(2):
        plane, *_ = np.linalg.lstsq(known[keep], values[keep], rcond=None)
        residual = np.abs(known @ plane - values)
        keep = residual <= 2 * np.median(residual[keep])
    return np.exp(np.clip(terms[..., :2] @ plane[:2], -_MAX_SLOPE, _MAX_SLOPE)).astype(np.float32)


def _paper_around(mask: Mask) -> Mask:
    """Return the pixels around `mask`, without those next to it, which lie in the leaf's shadow."""
    distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    side = float(np.sqrt(mask.sum()))
    return (distance > 0.06 * side + 2) & (distance < 0.6 * side + 4)


def _mirror_shape(frame: LeafFrame) -> LeafFrame:
    """Return a frame with the shape of `frame` mirrored at its axis."""
    return LeafFrame(
        frame.origin, frame.axis, frame.length, -frame.centre, frame.half_width, frame.has_petiole
    )


def _sample(image: NDArray[np.float32], points: Points, *, outside: float | None = None) -> FloatMap:
    """Sample `image` at points (x, y), [N, 2], bilinearly; beyond its border it is mirrored, or `outside`."""
    x, y = (points.T - 0.5).astype(np.float32)
    # OpenCV limits the sides of what it maps to to 32,767 pixels.
    columns = 256
    padding = -len(points) % columns
    x, y = (np.pad(axis, (0, padding), mode="edge").reshape(-1, columns) for axis in (x, y))
    border = cv2.BORDER_REFLECT if outside is None else cv2.BORDER_CONSTANT
    sampled = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=border, borderValue=outside or 0.0)
    return sampled.reshape(-1, *image.shape[2:])[: len(points)]
