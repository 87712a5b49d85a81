"""Samples as a data set stores them: encoded, with all that stands beside them.

Commands that change some parts of a data set, such as the image, read stored samples and write them again in
the same format: what they do not change stays as it is, byte for byte.
"""

import csv
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import tensorflow as tf
from google.protobuf.message import DecodeError

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.atomic_files import write_csv
from laesi_tf.common.errors import InputError
from laesi_tf.data import image_folders, tfrecords
from laesi_tf.data.dataset_spec import DatasetSpec
from laesi_tf.data.manifest import MANIFEST_FILE

Value = str | int | float | list[float]
_FILES = ("image", "mask", "edges")
_PNG_START = b"\x89PNG"


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredSample:
    """One sample: three encoded images, and by name the text and numbers beside them."""

    image: bytes
    """JPEG or PNG."""
    mask: bytes
    """PNG, 0 and 255."""
    edges: bytes
    """PNG, Canny edges of the mask."""
    values: Mapping[str, Value]
    """The other features of a record, or columns of a manifest."""

    @property
    def index(self) -> int:
        """Index of the sample in its data set."""
        return int(str(self.values["index"]))

    @property
    def seed(self) -> int:
        """Seed of the scene."""
        return int(str(self.values["seed"]))

    def decode_image(self) -> RgbImage:
        """Decode the image, uint8 [H, W, 3], as training does."""
        # This operation decodes PNG, too.
        return tf.io.decode_jpeg(self.image, channels=3, dct_method="INTEGER_ACCURATE").numpy()

    def decode_mask(self) -> Mask:
        """Decode the mask, bool [H, W]."""
        return tf.io.decode_png(self.mask, channels=1).numpy()[..., 0] > 127

    def with_image(self, image: bytes) -> "StoredSample":
        """Return the sample with another image, JPEG or PNG."""
        return dataclasses.replace(self, image=image)

    def with_values(self, **values: Value) -> "StoredSample":
        """Return the sample with further or other values."""
        return dataclasses.replace(self, values={**self.values, **values})


@dataclass(frozen=True)
class StoredFormat:
    """How a format of data sets reads a shard, and writes one completely or not at all."""

    read: Callable[[Path], Iterator[StoredSample]]
    write: Callable[[Path, Iterable[StoredSample]], None]
    find_damage: Callable[..., str | None]


def require_complete(folder: Path, spec: DatasetSpec) -> None:
    """Raise InputError if a shard of the data set in `folder` is missing or damaged."""
    if spec.format == "records":
        tfrecords.check_shards(folder, spec)
        return
    for shard in range(spec.shards):
        path = folder / spec.shard_name(shard)
        damage = image_folders.find_folder_damage(path, count=len(spec.sample_indices(shard)))
        if damage is not None:
            raise InputError(f"{path} is damaged: {damage}; run the command that wrote it again")


def read_records(path: Path) -> Iterator[StoredSample]:
    """Read a shard of TFRecords. Raises InputError if it is damaged or holds no such samples."""
    try:
        for record in tf.data.TFRecordDataset(str(path)).as_numpy_iterator():
            yield _parse_record(record, path)
    except tf.errors.OpError as error:
        raise InputError(
            f"cannot read {path} ({error.message}); run the command that wrote it again, which replaces it"
        ) from None


def write_records(path: Path, samples: Iterable[StoredSample]) -> None:
    """Write a shard of TFRecords. Raises InputError, for one if the disk is full."""
    tfrecords.write_shard(path, map(_encode_record, samples))


def _read_folder(path: Path) -> Iterator[StoredSample]:
    try:
        header, *rows = image_folders.read_table(path)
        for row in rows:
            columns: dict[str, Value] = dict(zip(header, row, strict=True))
            files = {name: (path / str(columns.pop(name))).read_bytes() for name in _FILES}
            yield StoredSample(**files, values=columns)
    except (OSError, ValueError, KeyError, csv.Error) as error:
        raise InputError(f"cannot read {path} ({error}); run the command that wrote it again") from None


def _write_folder(path: Path, samples: Iterable[StoredSample]) -> None:
    header: list[str] = []
    rows = []
    with image_folders.shard_folder(path) as folder:
        for sample in samples:
            suffix = ".png" if sample.image.startswith(_PNG_START) else ".jpg"
            names = [f"images/{sample.index:08}{suffix}", *(f"{n}/{sample.index:08}.png" for n in _FOLDERS)]
            contents = (sample.image, sample.mask, sample.edges)
            image_folders.write_files(folder, dict(zip(names, contents, strict=True)))
            header = [*_FILES, *sample.values]
            rows.append([*names, *map(_format_cell, sample.values.values())])
        write_csv(folder / MANIFEST_FILE, header, rows)


_FOLDERS = ("masks", "edges")


def _format_cell(value: Value) -> Value:
    return f"{value:.6g}" if isinstance(value, float) else value


STORED_FORMATS = {
    "records": StoredFormat(read_records, write_records, tfrecords.find_damage),
    "folder": StoredFormat(_read_folder, _write_folder, image_folders.find_folder_damage),
}
"""The formats of `laesi_tf.data.dataset_spec.FORMATS`."""


def _parse_record(record: bytes, path: Path) -> StoredSample:
    try:
        features = tf.train.Example.FromString(record).features.feature
    except DecodeError:
        features = {}
    missing = [name for name in (*_FILES, "index", "seed") if name not in features]
    if missing:
        raise InputError(f"a record of {path} has no {missing[0]}; name a data set that generate wrote")
    values = {name: _parse_feature(feature) for name, feature in features.items() if name not in _FILES}
    files = {name: features[name].bytes_list.value[0] for name in _FILES}
    return StoredSample(**files, values=values)


def _parse_feature(feature: tf.train.Feature) -> Value:
    if feature.bytes_list.value:
        return feature.bytes_list.value[0].decode()
    if feature.int64_list.value:
        return feature.int64_list.value[0]
    numbers = list(feature.float_list.value)
    return numbers[0] if len(numbers) == 1 else numbers


def _encode_record(sample: StoredSample) -> bytes:
    features = {
        **{name: tf.train.Feature(bytes_list={"value": [getattr(sample, name)]}) for name in _FILES},
        **{name: _encode_value(value) for name, value in sample.values.items()},
    }
    example = tf.train.Example(features=tf.train.Features(feature=features))
    return example.SerializeToString(deterministic=True)


def _encode_value(value: Value) -> tf.train.Feature:
    if isinstance(value, str):
        return tf.train.Feature(bytes_list={"value": [value.encode()]})
    if isinstance(value, int):
        return tf.train.Feature(int64_list={"value": [value]})
    return tf.train.Feature(float_list={"value": value if isinstance(value, list) else [value]})
