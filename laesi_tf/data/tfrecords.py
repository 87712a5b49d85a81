"""Samples as TFRecord shards: a data set that is generated once and read many times.

A data set is a folder: `dataset.json` describes it, and `pictures-00003-of-00100.tfrecord` is one of its
shards. A record is a tf.train.Example of

image      JPEG of quality 95 without chroma subsampling      area_cm2, px_per_mm, tilt_deg   float
mask       PNG, 0 and 255                                      to_px                           9 floats
edges      PNG, Canny edges of the mask                        seed, index                     int64
prompt     text for an image generator, UTF-8

Commands that change a data set add features of their own, which readers of these ignore: see
`laesi_tf.inpainting.repainting` and `laesi_tf.inpainting.filtering`.
"""

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.common.errors import InputError
from laesi_tf.data.canny import detect_canny_edges, species_prompt
from laesi_tf.data.dataset_spec import DatasetSpec, read_spec
from laesi_tf.data.encoding import encode_jpeg, encode_png
from laesi_tf.data.sample import ArraySample, Sample

_NUMBER_SHAPES = {"area_cm2": (), "px_per_mm": (), "tilt_deg": (), "to_px": (3, 3)}
_SHUFFLE_WINDOW = 2000


def encode_record(sample: ArraySample, *, seed: int, prompt: str) -> bytes:
    """Encode a rendered sample (see `laesi_tf.data.sample`); the same sample always gives the same bytes."""
    edges = detect_canny_edges(sample["mask"])
    features = {
        "image": _bytes_feature(encode_jpeg(sample["image"])),
        "mask": _bytes_feature(encode_png(sample["mask"] * 255)),
        "edges": _bytes_feature(encode_png(edges)),
        "prompt": _bytes_feature(prompt.encode()),
        "seed": _int_feature(seed),
        "index": _int_feature(int(sample["index"])),
        **{name: _float_feature(sample[name]) for name in _NUMBER_SHAPES},
    }
    example = tf.train.Example(features=tf.train.Features(feature=features))
    # Protocol buffers do not fix the order of a map otherwise.
    return example.SerializeToString(deterministic=True)


def decode_record(record: tf.Tensor) -> Sample:
    """Decode a record, string [], to the sample that `encode_record` got, with `edges` uint8 [H, W] 0/1."""
    schema = {name: tf.io.FixedLenFeature([], tf.string) for name in ("image", "mask", "edges", "prompt")}
    schema |= {name: tf.io.FixedLenFeature([], tf.int64) for name in ("seed", "index")}
    schema |= {name: tf.io.FixedLenFeature(shape, tf.float32) for name, shape in _NUMBER_SHAPES.items()}
    parsed = tf.io.parse_single_example(record, schema)
    planes = {name: tf.io.decode_png(parsed[name], channels=1)[..., 0] // 255 for name in ("mask", "edges")}
    image = tf.io.decode_jpeg(parsed["image"], channels=3, dct_method="INTEGER_ACCURATE")
    return parsed | {"image": image} | planes


def write_samples(path: Path, samples: Iterator[tuple[ArraySample, str]], spec: DatasetSpec) -> None:
    """Write a shard of (sample, species) pairs. Raises InputError as `write_shard` does."""
    write_shard(
        path,
        (
            encode_record(sample, seed=spec.seed, prompt=species_prompt(species))
            for sample, species in samples
        ),
    )


def write_shard(path: Path, records: Iterable[bytes]) -> None:
    """Write `records` to `path` completely or not at all. Raises InputError, for one if the disk is full."""
    with atomic_write(path) as temporary:
        try:
            with tf.io.TFRecordWriter(str(temporary)) as file:
                for record in records:
                    file.write(record)
        except tf.errors.OpError as error:
            raise InputError(
                f"cannot write {path} ({error.message}); free space and run the command again"
            ) from None


def read_samples(folder: Path | str) -> tf.data.Dataset:
    """Read the samples of a data set once, in order. Raises InputError if a shard is missing or truncated."""
    spec = read_spec(folder)
    return _decode_records(tf.data.TFRecordDataset(check_shards(Path(folder), spec)), spec)


def shuffle_samples(
    folder: Path | str, *, seed: int, start: int = 0, count: int | None = None
) -> tf.data.Dataset:
    """Read the samples of a data set, or its first `count`, endlessly and in a new order each time.

    `start` samples of that stream are skipped. Shards are shuffled as a whole, then each 2,000 successive
    samples: enough to separate the lighting passes of a leaf. Raises InputError if a shard is missing or
    truncated.
    """
    spec = read_spec(folder)
    count = spec.count if count is None else min(count, spec.count)
    files = tf.constant(check_shards(Path(folder), spec)[: -(-count // spec.per_shard)])

    def is_included(record: tf.Tensor) -> tf.Tensor:
        schema = {"index": tf.io.FixedLenFeature([], tf.int64)}
        return tf.io.parse_single_example(record, schema)["index"] < count

    def read_epoch(epoch: tf.Tensor) -> tf.data.Dataset:
        def shuffle_window(window: tf.Tensor, records: tf.Tensor) -> tf.data.Dataset:
            key = [seed, epoch * 2**20 + window + 1]
            order = tf.argsort(tf.random.stateless_uniform(tf.shape(records), key))
            return tf.data.Dataset.from_tensor_slices(tf.gather(records, order))

        order = tf.argsort(tf.random.stateless_uniform([len(files)], [seed, epoch * 2**20]))
        records = tf.data.TFRecordDataset(tf.gather(files, order)).filter(is_included)
        return records.batch(_SHUFFLE_WINDOW).enumerate().flat_map(shuffle_window)

    first_epoch, skipped = divmod(start, count)
    return _decode_records(tf.data.Dataset.range(first_epoch, 2**62).flat_map(read_epoch).skip(skipped), spec)


def check_shards(folder: Path, spec: DatasetSpec) -> list[str]:
    """Return the paths of all shards. Raises InputError if one is missing or truncated."""
    paths = [folder / spec.shard_name(shard) for shard in range(spec.shards)]
    missing = [path.name for path in paths if not path.is_file()]
    if missing:
        raise InputError(
            f"{folder} lacks {len(missing)} of {len(paths)} shards, the first {missing[0]}; "
            "run the command that wrote it again, which continues"
        )
    for shard, path in enumerate(paths):
        if count_records(path) != len(spec.sample_indices(shard)):
            raise InputError(f"{path} is truncated; run the command that wrote it again, which replaces it")
    return [str(path) for path in paths]


def count_records(path: Path) -> int:
    """Count the records of a shard from their lengths alone, without reading them.

    Returns -1 if the file is truncated. A record is framed by its length (8 bytes) and checksum (4) before it
    and its checksum (4) after it.
    """
    size, position, count = path.stat().st_size, 0, 0
    with path.open("rb") as file:
        while position < size:
            file.seek(position)
            header = file.read(12)
            if len(header) < 12:
                return -1
            position += 16 + struct.unpack("<Q", header[:8])[0]
            count += 1
    return count if position == size else -1


def find_damage(path: Path, *, count: int) -> str | None:
    """Read a shard and return what is wrong with it, or None if all `count` records match their checksums."""
    if (present := count_records(path)) != count:
        return "it is truncated" if present < 0 else f"it has {present} of {count} samples"
    try:
        tf.data.TFRecordDataset(str(path)).reduce(np.int64(0), lambda number, _: number + 1)
    except tf.errors.DataLossError:
        return "its bytes do not match their checksums"
    return None


def _decode_records(records: tf.data.Dataset, spec: DatasetSpec) -> tf.data.Dataset:
    shapes = {"image": (*spec.size, 3), "mask": spec.size, "edges": spec.size}

    def decode(record: tf.Tensor) -> Sample:
        sample = decode_record(record)
        return sample | {name: tf.ensure_shape(sample[name], shape) for name, shape in shapes.items()}

    return records.map(decode, num_parallel_calls=tf.data.AUTOTUNE)


def _bytes_feature(value: bytes) -> Any:
    return tf.train.Feature(bytes_list=tf.train.BytesList(value=[value]))


def _int_feature(value: int) -> Any:
    return tf.train.Feature(int64_list=tf.train.Int64List(value=[value]))


def _float_feature(value: NDArray[Any]) -> Any:
    return tf.train.Feature(float_list=tf.train.FloatList(value=np.ravel(value).tolist()))
