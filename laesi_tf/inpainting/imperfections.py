"""Deliberate imperfections of some exemplar repaintings, which the consistency filter should reject.

They resemble what diffusion models do wrong (paper, figure "Three instances of ControlNet-generated images"):
the leaf does not fill its mask. Each is a function of a texture, which it changes, and its strength is drawn
at random from nearly invisible to gross.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.common.arrays import FloatMap, Mask, RgbImage
from laesi_tf.common.geometry import pixel_centres
from laesi_tf.inpainting.leaf_frame import LeafFrame
from laesi_tf.inpainting.paper_fill import fill_with_paper
from laesi_tf.inpainting.texture_warp import Alignment, fill_gaps, match_light, warp_texture


@dataclass(frozen=True, kw_only=True, eq=False)
class Canvas:
    """What an imperfection may use: the image with its mask and frame, and two donors on it."""

    image: RgbImage
    mask: Mask
    frame: LeafFrame
    alignment: Alignment
    neighbour: Alignment

    def paint(self, alignment: Alignment) -> FloatMap:
        """Return the faithful texture [H, W, 3] of a donor."""
        warp = warp_texture(alignment, self.frame, self.mask)
        return match_light(fill_gaps(warp, self.mask), alignment.donor, self.image, self.mask)

    def uncover(self, texture: FloatMap, is_bare: Mask) -> FloatMap:
        """Return `texture` with paper where `is_bare` [H, W]."""
        paper = fill_with_paper(self.image, self.mask).astype(np.float32)
        return np.where((is_bare & self.mask)[..., None], paper, texture)


def drift(canvas: Canvas, random: np.random.Generator) -> FloatMap:
    """Move the texture, so that paper shows at a margin."""
    angle, size = random.uniform(0, 2 * np.pi), random.uniform(0.03, 0.6)
    shift = (0.5 * size * np.cos(angle), size * np.sin(angle))
    moved = warp_texture(canvas.alignment, canvas.frame, canvas.mask, shift=shift)
    # Gaps that the faithful texture has, too, are filled: the donor's shape is not the target's.
    own = warp_texture(canvas.alignment, canvas.frame, canvas.mask)
    texture = match_light(fill_gaps(moved, canvas.mask), canvas.alignment.donor, canvas.image, canvas.mask)
    coordinates = canvas.frame.to_leaf(pixel_centres(canvas.mask)) - shift
    is_beyond = np.zeros_like(canvas.mask)
    is_beyond[canvas.mask] = (np.abs(coordinates - [0.5, 0]) > [0.5, 1]).any(axis=1)
    return canvas.uncover(texture, (own.is_leaf & ~moved.is_leaf) | is_beyond)


def holes(canvas: Canvas, random: np.random.Generator) -> FloatMap:
    """Leave round holes in the leaf, a few per cent of it to nearly a half."""
    texture = canvas.paint(canvas.alignment)
    wanted = random.uniform(0.02, 0.45) * canvas.mask.sum()
    bare = np.zeros(canvas.mask.shape, np.uint8)
    centres = np.argwhere(canvas.mask)
    for _ in range(30):
        if np.count_nonzero(bare[canvas.mask]) >= wanted:
            break
        row, column = centres[random.integers(len(centres))]
        radius = random.uniform(0.05, 0.2) * np.sqrt(canvas.mask.sum())
        axes = (max(1, round(radius)), max(1, round(radius * random.uniform(0.6, 1))))
        angle = random.uniform(0, 180)
        cv2.ellipse(bare, (int(column), int(row)), axes, angle, 0, 360, 1, cv2.FILLED)
    return canvas.uncover(texture, bare > 0)


def neighbour_edge(canvas: Canvas, random: np.random.Generator) -> FloatMap:
    """Let another leaf begin inside the mask, behind a strip of paper of any width."""
    texture, other = canvas.paint(canvas.alignment), canvas.paint(canvas.neighbour)
    points = canvas.frame.to_leaf(pixel_centres(canvas.mask)) - [0.5, 0]
    angle = random.uniform(0, 2 * np.pi)
    # In units of half the blade's length along and half its width across.
    points = points * [2, 1]
    direction = np.array([np.cos(angle), np.sin(angle)])
    crosswise = points @ np.array([-direction[1], direction[0]])
    distance = points @ direction + 0.1 * np.sin(3 * crosswise + angle)
    start, strip = random.uniform(-0.3, 0.5), random.uniform(0.0, 0.6)
    bare, beyond = np.zeros_like(canvas.mask), np.zeros_like(canvas.mask)
    bare[canvas.mask] = (distance > start) & (distance < start + strip)
    beyond[canvas.mask] = distance >= start + strip
    return canvas.uncover(np.where(beyond[..., None], other, texture), bare)


IMPERFECTIONS: dict[str, Callable[[Canvas, np.random.Generator], FloatMap]] = {
    "drift": drift,
    "holes": holes,
    "neighbour's edge": neighbour_edge,
}
"""All imperfections by the name that is stored with an image."""
