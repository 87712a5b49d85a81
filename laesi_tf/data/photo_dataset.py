"""Real photos as training pictures: held in memory at the network's size, or read anew each time.

A picture is a dict of `image` uint8 [h, w, 3], `mask` uint8 [h, w] 0/1 (all 0 where the manifest names none),
`area_cm2` and `px_per_mm` float32 [] (NaN where the manifest does not say).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.letterbox import letterbox_image, letterbox_mask
from laesi_tf.data.manifest import Photo
from laesi_tf.data.prefetch import prefetch


@dataclass(frozen=True)
class SkippedPhoto:
    """A photo that could not be used, by the name the user knows it by, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class IndexedSamples:
    """`count` pictures; `at` makes the one at an index, int64 [], and works in a graph."""

    count: int
    at: Callable[[tf.Tensor], dict[str, tf.Tensor]]


def load_into_memory(
    photos: Sequence[Photo], *, size: tuple[int, int], masked: bool
) -> tuple[IndexedSamples, list[SkippedPhoto]]:
    """The usable photos, decoded once, now, and kept at `size` (200 kB each at 224 x 224), and the others.

    With `masked`, photos without a mask are of no use. Raises InputError when none is usable.
    """
    results = list(prefetch(lambda photo: load_sample(photo, size=size, masked=masked), photos))
    skipped = [
        SkippedPhoto(photo.name, str(result)) for photo, result in results if isinstance(result, InputError)
    ]
    usable = [result for _, result in results if not isinstance(result, InputError)]
    if not usable:
        raise InputError(f"none of the {len(photos)} photos can be used; first: {skipped[0].reason}")
    columns = {name: tf.constant(np.stack([picture[name] for picture in usable])) for name in usable[0]}
    pictures = IndexedSamples(
        len(usable), lambda index: {name: column[index] for name, column in columns.items()}
    )
    return pictures, skipped


def stream_from_disk(photos: Sequence[Photo], *, size: tuple[int, int], masked: bool) -> IndexedSamples:
    """Every photo, decoded each time it is asked for. One that cannot be used gives way to the next that can.

    Raises InputError when none can; from within a dataset as an error of TensorFlow's that quotes it.
    """
    types = {"image": tf.uint8, "mask": tf.uint8, "area_cm2": tf.float32, "px_per_mm": tf.float32}
    shapes = {"image": (*size, 3), "mask": size, "area_cm2": (), "px_per_mm": ()}

    def usable(index: np.ndarray) -> list[np.ndarray]:
        reason = ""
        for offset in range(len(photos)):
            try:
                picture = load_sample(photos[(int(index) + offset) % len(photos)], size=size, masked=masked)
                return [picture[name] for name in types]
            except InputError as error:
                reason = reason or str(error)
        raise InputError(f"none of the {len(photos)} photos can be used; first: {reason}")

    def at(index: tf.Tensor) -> dict[str, tf.Tensor]:
        values = tf.numpy_function(usable, [index], list(types.values()), stateful=False)
        return {name: tf.ensure_shape(value, shapes[name]) for name, value in zip(types, values, strict=True)}

    return IndexedSamples(len(photos), at)


def load_sample(photo: Photo, *, size: tuple[int, int], masked: bool) -> dict[str, np.ndarray]:
    """The picture of one photo. Raises InputError, with `masked` also for a photo without a mask."""
    if masked and photo.mask is None:
        raise InputError(f"{photo.name} has no mask in its manifest; add one to train on masks")
    image, letterbox = letterbox_image(decode_photo(photo.image), size)
    scale = math.nan if photo.px_per_mm is None else photo.px_per_mm * math.sqrt(letterbox.scale.prod())
    return {
        "image": image,
        "mask": np.zeros(size, np.uint8)
        if photo.mask is None
        else letterbox_mask(decode_mask(photo.mask), size),
        "area_cm2": np.array(photo.area_cm2, np.float32),
        "px_per_mm": np.array(scale, np.float32),
    }
