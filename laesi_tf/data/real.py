"""Real photos as a source of training pictures, held in memory at the network's size."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import tensorflow as tf

from laesi_tf.data.ahead import read_ahead
from laesi_tf.data.decoding import decode, decode_mask
from laesi_tf.data.fitting import Placement, fit, fit_mask
from laesi_tf.data.photos import Photo
from laesi_tf.errors import InputError


@dataclass(frozen=True)
class Skipped:
    """A photo that could not be used, by the name the user knows it by, and why."""

    name: str
    reason: str


def photos_dataset(
    photos: Sequence[Photo], *, size: tuple[int, int], task: Literal["area", "mask"] = "area"
) -> tuple[tf.data.Dataset, list[Skipped]]:
    """Return (image, target) of every readable photo once, unbatched, in order; and the photos left out.

    image is uint8 [h, w, 3]; target is that of `laesi_tf.data.synthetic.target`: float32 [3] (area in cm2,
    px per mm, leaf's share; NaN where the manifest does not say) or for `task="mask"` uint8 [h, w]. Photos
    are decoded once, now, and kept at `size` (150 kB each at 224 x 224). Raises InputError when
    none is usable.
    """

    def read(photo: Photo) -> tuple[np.ndarray, np.ndarray]:
        image, placement = fit(decode(photo.image), size)
        return image, _area(photo, size, placement) if task == "area" else _mask(photo, size)

    results = list(read_ahead(read, photos))
    skipped = [
        Skipped(photo.name, str(result)) for photo, result in results if isinstance(result, InputError)
    ]
    pairs = [result for _, result in results if not isinstance(result, InputError)]
    if not pairs:
        raise InputError(f"none of the {len(photos)} photos can be used; first: {skipped[0].reason}")
    images, targets = (np.stack(column) for column in zip(*pairs, strict=True))
    return tf.data.Dataset.from_tensor_slices((images, targets)), skipped


def _area(photo: Photo, size: tuple[int, int], placement: Placement) -> np.ndarray:
    scale = math.nan if photo.px_per_mm is None else photo.px_per_mm * math.sqrt(math.prod(placement.scale))
    share = math.nan if photo.mask is None else float(_mask(photo, size).mean())
    return np.array([photo.area_cm2, scale, share or math.nan], np.float32)


def _mask(photo: Photo, size: tuple[int, int]) -> np.ndarray:
    if photo.mask is None:
        raise InputError(f"{photo.name} has no mask in its manifest; add one to train on masks")
    return fit_mask(decode_mask(photo.mask), size)
