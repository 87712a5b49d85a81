"""Photos as training samples: held in memory at the network's input size, or decoded again each time.

See `laesi_tf.data.sample` for the keys.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.letterbox import letterbox_image, letterbox_mask
from laesi_tf.data.manifest import Photo
from laesi_tf.data.prefetch import prefetch
from laesi_tf.data.sample import COMMON_KEYS, ArraySample, Sample


@dataclass(frozen=True)
class SkippedPhoto:
    """A photo that could not be used, by its name in the manifest, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class IndexedSamples:
    """`count` samples; `get` returns the one at an index, int64 [], also inside a graph."""

    count: int
    get: Callable[[tf.Tensor], Sample]


def load_into_memory(
    photos: Sequence[Photo], *, size: tuple[int, int], needs_masks: bool
) -> tuple[IndexedSamples, list[SkippedPhoto]]:
    """Decode all photos now and keep them at `size` (200 kB each at 224 x 224); return also those skipped.

    With `needs_masks`, photos without a mask are skipped. Raises InputError if none is left.
    """
    results = list(prefetch(lambda photo: load_sample(photo, size=size, needs_mask=needs_masks), photos))
    skipped = [
        SkippedPhoto(photo.name, str(result)) for photo, result in results if isinstance(result, InputError)
    ]
    loaded = [result for _, result in results if not isinstance(result, InputError)]
    if not loaded:
        raise InputError(f"none of the {len(photos)} photos can be used; first: {skipped[0].reason}")
    columns = {name: tf.constant(np.stack([sample[name] for sample in loaded])) for name in COMMON_KEYS}
    samples = IndexedSamples(
        len(loaded), lambda index: {name: column[index] for name, column in columns.items()}
    )
    return samples, skipped


def stream_from_disk(photos: Sequence[Photo], *, size: tuple[int, int], needs_masks: bool) -> IndexedSamples:
    """Decode a photo each time it is needed; the next usable photo replaces one that cannot be used.

    Raises InputError if none can be used; inside a dataset, a TensorFlow error that quotes it.
    """
    types = {"image": tf.uint8, "mask": tf.uint8, "area_cm2": tf.float32, "px_per_mm": tf.float32}
    shapes = {"image": (*size, 3), "mask": size, "area_cm2": (), "px_per_mm": ()}

    def load_usable(index: NDArray[np.int64]) -> list[NDArray[Any]]:
        reason = ""
        for offset in range(len(photos)):
            photo = photos[(int(index) + offset) % len(photos)]
            try:
                sample = load_sample(photo, size=size, needs_mask=needs_masks)
                return [sample[name] for name in types]
            except InputError as error:
                reason = reason or str(error)
        raise InputError(f"none of the {len(photos)} photos can be used; first: {reason}")

    def get(index: tf.Tensor) -> Sample:
        values = tf.numpy_function(load_usable, [index], list(types.values()), stateful=False)
        return {name: tf.ensure_shape(value, shapes[name]) for name, value in zip(types, values, strict=True)}

    return IndexedSamples(len(photos), get)


def load_sample(photo: Photo, *, size: tuple[int, int], needs_mask: bool) -> ArraySample:
    """Load one photo, letterboxed to `size` (h, w), as a sample.

    Raises InputError; with `needs_mask`, also for a photo without a mask.
    """
    if needs_mask and photo.mask is None:
        raise InputError(f"{photo.name} has no mask in its manifest; add one to train on masks")
    image, letterbox = letterbox_image(decode_photo(photo.image), size)
    mask = np.zeros(size, np.uint8)
    if photo.mask is not None:
        mask = letterbox_mask(decode_mask(photo.mask), size)
    px_per_mm = math.nan
    if photo.px_per_mm is not None:
        px_per_mm = photo.px_per_mm * math.sqrt(math.prod(letterbox.scale))
    return {
        "image": image,
        "mask": mask,
        "area_cm2": np.array(photo.area_cm2, np.float32),
        "px_per_mm": np.array(px_per_mm, np.float32),
    }
