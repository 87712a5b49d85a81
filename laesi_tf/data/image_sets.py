"""Load the images of any set: a manifest, TFRecords, or a folder of image files."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.errors import InputError
from laesi_tf.data.dataset_spec import SPEC_FILE, read_spec
from laesi_tf.data.decoding import decode_photo
from laesi_tf.data.file_formats import PHOTO_SUFFIXES
from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.data.manifest import MANIFEST_FILE, read_manifest
from laesi_tf.data.prefetch import prefetch

Item = TypeVar("Item")


@dataclass(frozen=True)
class ImageSet:
    """A set of images: files, or the TFRecords in a folder if there are no files."""

    path: Path
    files: Sequence[Path]
    spec_count: int = 0
    """Number of samples in the TFRecords."""

    @property
    def count(self) -> int:
        """Number of images."""
        return len(self.files) or self.spec_count


def find_images(path: Path, *, split: str | None = None) -> ImageSet:
    """Find the images of the set at `path` without reading them.

    `path` is a manifest (CSV) or a folder: of TFRecords, with a manifest.csv, or of image files. `split`
    selects a split of a manifest. Raises InputError if there is no image.
    """
    manifest = path / MANIFEST_FILE if path.is_dir() else path
    if manifest.is_file():
        return ImageSet(path, [photo.image for photo in read_manifest(manifest, split=split)])
    if not path.is_dir():
        raise InputError(f"no images at {path}; name a manifest or a folder")
    if split is not None:
        raise InputError(f"{path} has no {MANIFEST_FILE}, so it has no split {split!r}")
    if (path / SPEC_FILE).is_file():
        return ImageSet(path, [], read_spec(path).count)
    files = sorted(file for file in path.rglob("*") if file.suffix.lower() in PHOTO_SUFFIXES)
    if not files:
        raise InputError(f"no images in {path}; name a manifest or a folder of photos")
    return ImageSet(path, files)


def load_images(
    images: ImageSet, *, size: tuple[int, int], count: int
) -> tuple[NDArray[np.uint8], list[str], list[str]]:
    """Load at most `count` images, evenly spaced in the set.

    Returns the images as uint8 [N, h, w, 3] letterboxed to `size` (h, w), their names, and a message for each
    file that cannot be read. Raises InputError if none can be read.
    """
    if not images.files:
        loaded = list(_letterbox_records(images.path, size, set(_pick_evenly(range(images.count), count))))
        return np.stack([image for image, _ in loaded]), [name for _, name in loaded], []
    pixels, names, errors = [], [], []
    for file, image in prefetch(decode_photo, _pick_evenly(images.files, count)):
        if isinstance(image, InputError):
            errors.append(str(image))
        else:
            pixels.append(letterbox_image(image, size)[0])
            names.append(file.name)
    if not pixels:
        raise InputError(f"no image in {images.path} can be read; the first: {errors[0]}")
    return np.stack(pixels), names, errors


def _letterbox_records(
    folder: Path, size: tuple[int, int], positions: set[int]
) -> Iterator[tuple[NDArray[np.uint8], str]]:
    # Here, not above: `find_images` must answer before TensorFlow is imported.
    from laesi_tf.data.tfrecords import read_samples

    for position, sample in enumerate(read_samples(folder).as_numpy_iterator()):
        if position in positions:
            yield letterbox_image(sample["image"], size)[0], f"image {sample['index']}"


def _pick_evenly(items: Sequence[Item], count: int) -> Sequence[Item]:
    """Return at most `count` of `items`, evenly spaced."""
    if len(items) <= count:
        return items
    return [items[position] for position in np.linspace(0, len(items) - 1, count).round().astype(int)]
