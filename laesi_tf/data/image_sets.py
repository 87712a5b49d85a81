"""Load the images of any set: a manifest, TFRecords, or a folder of image files."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from laesi_tf.common.errors import InputError
from laesi_tf.data import dataset_spec, tfrecords
from laesi_tf.data.decoding import PHOTO_SUFFIXES, decode_photo
from laesi_tf.data.image_folders import MANIFEST_FILE
from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.data.manifest import read_manifest
from laesi_tf.data.prefetch import prefetch


def load_images(
    path: Path, *, size: tuple[int, int], count: int, split: str | None = None
) -> tuple[np.ndarray, list[str], list[str]]:
    """At most `count` pictures of the set at `path`, spread evenly over it, and what they are called.

    `path` is a manifest (CSV) or a folder: of records, with a manifest.csv, or of image files. Returns the
    pictures as uint8 [N, h, w, 3] at `size`, their names, and a line for each file that cannot be read; a
    `split` is one of a manifest's. Raises InputError where there is no picture.
    """
    if path.is_dir() and not (path / MANIFEST_FILE).is_file() and _has_records(path):
        _require_no_split(path, split)
        found = _load_records(path, size, count)
        return np.stack([image for image, _ in found]), [name for _, name in found], []
    files = _pick_evenly(_list_files(path, split), count)
    images, names, unread = [], [], []
    for file, image in prefetch(decode_photo, files):
        if isinstance(image, InputError):
            unread.append(str(image))
        else:
            images.append(letterbox_image(image, size)[0])
            names.append(file.name)
    if not images:
        raise InputError(f"{path} has no picture that can be read; name a manifest or a folder of pictures")
    return np.stack(images), names, unread


def _has_records(folder: Path) -> bool:
    return (folder / dataset_spec.SPEC_FILE).is_file()


def _load_records(folder: Path, size: tuple[int, int], count: int) -> list[tuple[np.ndarray, str]]:
    contents = dataset_spec.read_spec(folder)
    chosen = set(_pick_evenly(list(range(contents.count)), count))
    return list(_letterbox_records(folder, size, chosen))


def _letterbox_records(
    folder: Path, size: tuple[int, int], chosen: set[int]
) -> Iterator[tuple[np.ndarray, str]]:
    for place, picture in enumerate(tfrecords.read_samples(folder).as_numpy_iterator()):
        if place in chosen:
            yield letterbox_image(picture["image"], size)[0], f"picture {picture['index']}"


def _list_files(path: Path, split: str | None) -> list[Path]:
    manifest = path / MANIFEST_FILE if path.is_dir() else path
    if manifest.is_file():
        return [photo.image for photo in read_manifest(manifest, split=split)]
    if not path.is_dir():
        raise InputError(f"no pictures at {path}; name a manifest or a folder")
    _require_no_split(path, split)
    return sorted(file for file in path.rglob("*") if file.suffix.lower() in PHOTO_SUFFIXES)


def _require_no_split(path: Path, split: str | None) -> None:
    if split is not None:
        raise InputError(f"{path} has no {MANIFEST_FILE}, which is what would name a split")


def _pick_evenly(items: list, count: int) -> list:
    """At most `count` of `items`, evenly spread."""
    if len(items) <= count:
        return items
    return [items[place] for place in np.linspace(0, len(items) - 1, count).round().astype(int)]
