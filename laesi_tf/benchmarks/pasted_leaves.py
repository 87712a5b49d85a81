"""Benchmark `leaves`: which of several leaves are found, on photos on which leaves of others are pasted.

Photographs of one leaf with its mask are common; of several with all their masks they are not. Pasted leaves
lie on bare paper beside the photo's own one, from half its size to a quarter larger, turned at random.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.benchmarks.timing import format_row
from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.metrics import ious
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.manifest import Photo
from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling_estimator import UNCOUNTED
from laesi_tf.estimators.sheet_colour import compare_with_paper
from laesi_tf.evaluation.photo_scores import load_photo_and_mask

_MOST_PASTED = 3
_SIZES = (0.5, 1.25)
"""Longer side of a pasted leaf, over that of the photo's own leaf."""
_GAP = 0.012
"""Leaves are at least so far apart, share of the photo's longer side."""
_PLACES = 40
"""Places that are tried for a leaf."""
_MAX_TINT = 8.0
"""Paper differs so little in colour from what surrounds the photo's own leaf, CIELAB."""
_FALSE_OUTLINE = 0.1
"""One that has less in common with each leaf shows none."""
_SAME_LEAF = 0.5
"""Intersection over union from which an outline is that of a leaf."""


@dataclass(frozen=True, eq=False)
class SeveralLeaves:
    """A photo of several leaves."""

    image: RgbImage
    """uint8 [h, w, 3]."""
    leaves: tuple[Mask, ...]
    """bool [h, w] each."""
    info: PhotoInfo


def measure_pasted_leaves(
    estimator: Estimator, photos: Sequence[Photo], *, count: int, seed: int
) -> dict[str, Any]:
    """Measure `count` photos with pasted leaves; count the leaves that are missed and outlines of no leaf.

    `photos` have masks. Raises InputError if they have none, or one cannot be read.
    """
    found = missed = unsaid = extra = refused = 0
    scenes = paste_leaves(photos, count=count, seed=seed)
    for scene in progress_bar(scenes, total=count, desc="photos", unit="photo"):
        measurement = estimator.measure(scene.image, scene.info)
        if measurement.refusal is not None:
            refused += 1
            continue
        photo = PhotoPyramid(scene.image).photo
        outlines = [photo.paint([leaf.outline]) for leaf in measurement.leaves if leaf.outline is not None]
        overlaps = np.array([[ious(outline, leaf)[0] for outline in outlines] for leaf in scene.leaves])
        is_found = (overlaps > _SAME_LEAF).any(axis=1)
        found += int(is_found.sum())
        missed += int((~is_found).sum())
        is_said = UNCOUNTED.partition("{")[0] in (measurement.note or "")
        unsaid += 0 if is_said else int((~is_found).sum())
        extra += int((overlaps.max(axis=0) < _FALSE_OUTLINE).sum())
    return {
        "photos": count,
        "refused": refused,
        "leaves": found + missed,
        "missed": missed,
        "missed_without_a_note": unsaid,
        "false_outlines": extra,
        "seed": seed,
        **describe_hardware(),
    }


def paste_leaves(photos: Sequence[Photo], *, count: int, seed: int) -> Iterator[SeveralLeaves]:
    """Yield `count` photos, each with up to three leaves of others pasted beside its own.

    Raises InputError if fewer than two photos have masks, or one cannot be read.
    """
    masked = [photo for photo in photos if photo.mask is not None]
    if len(masked) < 2:
        raise InputError("leaves are pasted from photos with masks; name a manifest with a column mask")
    for number in range(count):
        random = np.random.default_rng([seed, number])
        donor_count = min(int(random.integers(1, _MOST_PASTED + 1)), len(masked) - 1)
        base, *donors = random.choice(len(masked), 1 + donor_count, replace=False)
        image, leaf = _load(masked[base])
        image, leaves = image.copy(), [leaf]
        length = max(cv2.boundingRect(leaf.astype(np.uint8))[2:])
        for donor in donors:
            size = random.uniform(*_SIZES) * length
            colours, shape = _cut_out(*_load(masked[donor]), size, random.uniform(0, 360))
            if (pasted := _paste(image, leaves, colours, shape, random)) is not None:
                leaves.append(pasted)
        photo = masked[base]
        info = PhotoInfo(px_per_mm=photo.px_per_mm, grid_mm=photo.grid_mm)
        yield SeveralLeaves(image, tuple(leaves), info)


def format_table(metrics: Mapping[str, Any]) -> str:
    """Format the figures of `measure_pasted_leaves`."""
    names = ("photos", "refused", "leaves", "missed", "missed_without_a_note", "false_outlines")
    rows = [format_row(name.replace("_", " "), str(metrics[name])) for name in names]
    machine = "seed {seed}, {machine}, {cores} cores, {date}".format_map(metrics)
    return "\n".join([*rows, machine])


def _load(photo: Photo) -> tuple[RgbImage, Mask]:
    """Return a photo and its mask. Raises InputError."""
    image, mask = load_photo_and_mask(photo)
    assert mask is not None, "the photo was chosen for its mask"
    return image, mask


def _cut_out(
    image: RgbImage, mask: Mask, length: float, turn_deg: float
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return a leaf turned and scaled to `length` pixels: uint8 [n, n, 3], and its opacity float32 [n, n]."""
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    scale, side = length / max(width, height), int(1.5 * length)
    matrix = cv2.getRotationMatrix2D((left + width / 2, top + height / 2), turn_deg, scale)
    matrix[:, 2] += side / 2 - np.array([left + width / 2, top + height / 2])
    colours = cv2.warpAffine(image, matrix, (side, side), flags=cv2.INTER_LINEAR)
    opacity = cv2.warpAffine(mask.astype(np.float32), matrix, (side, side), flags=cv2.INTER_LINEAR)
    return colours, opacity


def _paste(
    image: RgbImage,
    leaves: Sequence[Mask],
    colours: NDArray[np.uint8],
    opacity: NDArray[np.float32],
    random: np.random.Generator,
) -> Mask | None:
    """Paste a leaf where none of `leaves` is near; return its mask, or None where there is no room."""
    height, width = image.shape[:2]
    shape = opacity > 0.5
    left, top, across, down = cv2.boundingRect(shape.astype(np.uint8))
    box = (slice(top, top + down), slice(left, left + across))
    gap = max(2, round(_GAP * max(height, width)))
    if across + 2 * gap >= width or down + 2 * gap >= height:
        return None
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * gap + 1, 2 * gap + 1))
    taken = cv2.dilate(np.any(leaves, axis=0).astype(np.uint8), disc) > 0
    taken |= ~_find_paper(image, leaves[0])
    for _ in range(_PLACES):
        x, y = random.integers(gap, width - across - gap), random.integers(gap, height - down - gap)
        place = (slice(y, y + down), slice(x, x + across))
        if (taken[place] & shape[box]).any():
            continue
        share = opacity[box][..., None]
        image[place] = np.round(share * colours[box] + (1 - share) * image[place]).astype(np.uint8)
        mask = np.zeros((height, width), bool)
        mask[place] = shape[box]
        return mask
    return None


def _find_paper(image: RgbImage, leaf: Mask) -> Mask:
    """Return where `image` has the colour of what surrounds its own `leaf`, in light or shadow."""
    unit = max(3, max(leaf.shape) // 50 | 1)
    far, near = (cv2.dilate(leaf.astype(np.uint8), np.ones([n * unit] * 2, np.uint8)) for n in (4, 2))
    tint, shade = compare_with_paper(cv2.blur(image, (unit, unit)), (far > 0) & (near == 0))
    paper: Mask = (tint < _MAX_TINT) & (shade > -np.log(2))
    return paper
