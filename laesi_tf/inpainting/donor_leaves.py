"""Leaves of photos, which lend their texture to synthetic ones."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.manifest import MANIFEST_FILE, Photo, read_manifest
from laesi_tf.data.prefetch import prefetch
from laesi_tf.inpainting.leaf_frame import LeafFrame, fit_leaf_frame

_MAX_SIDE_PX = 512
"""Donors are kept at this size at most: 450 of them need 0.4 GB."""
_MIN_AREA_PX = 1000
_BORDER = 0.15
"""Paper that is kept around a leaf, relative to its longer side."""
_RIM_PX = 2
"""Pixels at the margin that have colour of the paper, too."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Donor:
    """A leaf of a photo, cut out with some paper around it."""

    name: str
    image: RgbImage
    """uint8 [h, w, 3]."""
    leaf: Mask
    """bool [h, w], without the pixels at the margin."""
    frame: LeafFrame
    paper: NDArray[np.float64]
    """[3] median colour of the paper around the leaf."""


def load_donors(folder: Path, *, split: str | None = None) -> list[Donor]:
    """Load the leaves of the photos in the manifest of `folder`, or of its `split`.

    A photo that cannot be used is skipped with a warning. Raises InputError if the folder has no manifest, or
    none of its photos has a mask or can be read.
    """
    photos = [photo for photo in find_donor_photos(folder, split=split) if photo.mask is not None]
    donors, errors = [], []
    loading = progress_bar(prefetch(_load_donor, photos), total=len(photos), desc="textures", unit="photo")
    for photo, donor in loading:
        if isinstance(donor, InputError):
            errors.append(donor)
            warnings.warn(f"texture skipped: {photo.name}: {donor}", stacklevel=2)
        else:
            donors.append(donor)
    if not donors:
        raise InputError(f"none of the {len(photos)} photos in {folder} can be used; first: {errors[0]}")
    return donors


def find_donor_photos(folder: Path, *, split: str | None) -> list[Photo]:
    """Return the photos that the manifest in `folder` lists. Raises InputError if none has a mask."""
    manifest = folder / MANIFEST_FILE if folder.is_dir() else folder
    if not manifest.is_file():
        raise InputError(
            f"no textures at {folder}: {MANIFEST_FILE} is missing; name a folder of photos whose manifest "
            "has a column mask"
        )
    photos = read_manifest(manifest, split=split)
    if not any(photo.mask for photo in photos):
        raise InputError(f"no photo in {manifest} has a mask; add the column mask")
    return photos


def cut_out_donor(name: str, image: RgbImage, mask: Mask) -> Donor:
    """Cut the largest leaf in `mask` [H, W] out of `image` [H, W, 3].

    Raises InputError if it is too small or too narrow.
    """
    mask = _keep_largest(mask)
    if mask.sum() < _MIN_AREA_PX:
        raise InputError(f"its leaf has {int(mask.sum())} pixels; at least {_MIN_AREA_PX} are needed")
    rows, columns = np.nonzero(mask)
    border = round(_BORDER * max(np.ptp(rows), np.ptp(columns)))
    box = tuple(slice(max(0, side.min() - border), side.max() + 1 + border) for side in (rows, columns))
    image, mask = image[box], mask[box]
    scale = min(1.0, _MAX_SIDE_PX / max(mask.shape))
    if scale < 1:
        size = tuple(max(1, round(side * scale)) for side in mask.shape[::-1])
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        mask = cv2.resize(mask.astype(np.uint8) * 255, size, interpolation=cv2.INTER_AREA) > 127
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _RIM_PX + 1, 2 * _RIM_PX + 1))
    inner = cv2.erode(mask.astype(np.uint8), kernel, borderValue=0) > 0
    if not inner.any():
        raise InputError("its leaf is too narrow: nowhere is it wider than the edges")
    around = cv2.dilate(mask.astype(np.uint8), kernel) == 0
    paper = np.median(image[around], axis=0) if around.any() else np.full(3, 255.0)
    return Donor(name=name, image=image, leaf=inner, frame=fit_leaf_frame(mask), paper=paper)


def _keep_largest(mask: Mask) -> Mask:
    """Return the largest connected part of `mask` [H, W]."""
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = statistics[1:, cv2.CC_STAT_AREA]
    return labels == 1 + int(np.argmax(areas)) if len(areas) else mask


def _load_donor(photo: Photo) -> Donor:
    assert photo.mask is not None
    image, mask = decode_photo(photo.image), decode_mask(photo.mask)
    if image.shape[:2] != mask.shape:
        raise InputError("its mask has another size")
    return cut_out_donor(photo.name, image, mask)
