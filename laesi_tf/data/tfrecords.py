"""Pictures as TFRecord shards: a data set that is made once and read many times.

A data set is a folder: `dataset.json` says what it holds, and `pictures-00003-of-00100.tfrecord` is one of
its shards. A record is a tf.train.Example of

image      JPEG of quality 95 without colour subsampling      area_cm2, px_per_mm, tilt_deg   float
mask       PNG, 0 and 255                                      to_px                           9 floats
edges      PNG, Canny edges of the mask                        seed, index                     int64
prompt     text for an image generator, UTF-8
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.common.errors import InputError
from laesi_tf.data.canny import detect_canny_edges, species_prompt
from laesi_tf.data.dataset_spec import DatasetSpec, read_spec
from laesi_tf.data.encoding import encode_jpeg, encode_png

_NUMBER_SHAPES = {"area_cm2": (), "px_per_mm": (), "tilt_deg": (), "to_px": (3, 3)}
_SHUFFLE_WINDOW = 2000


def encode_record(picture: Mapping[str, np.ndarray], *, seed: int, prompt: str) -> bytes:
    """One record of a picture with image uint8 [H, W, 3], mask uint8 [H, W] 0/1, its numbers and its index.

    The same picture always gives the same bytes.
    """
    features = {
        "image": _bytes_feature(encode_jpeg(picture["image"])),
        "mask": _bytes_feature(encode_png(picture["mask"] * 255)),
        "edges": _bytes_feature(encode_png(detect_canny_edges(picture["mask"]))),
        "prompt": _bytes_feature(prompt.encode()),
        "seed": _int_feature(seed),
        "index": _int_feature(int(picture["index"])),
        **{name: _float_feature(picture[name]) for name in _NUMBER_SHAPES},
    }
    # Protocol buffers leave the order of a map open unless they are asked for one.
    example = tf.train.Example(features=tf.train.Features(feature=features))
    return example.SerializeToString(deterministic=True)


def decode_record(record: tf.Tensor) -> dict[str, tf.Tensor]:
    """The picture in a record, string []: as `encode` took it, with `edges` uint8 [H, W] 0/1 besides."""
    schema = {name: tf.io.FixedLenFeature([], tf.string) for name in ("image", "mask", "edges", "prompt")}
    schema |= {name: tf.io.FixedLenFeature([], tf.int64) for name in ("seed", "index")}
    schema |= {name: tf.io.FixedLenFeature(shape, tf.float32) for name, shape in _NUMBER_SHAPES.items()}
    parsed = tf.io.parse_single_example(record, schema)
    binary = {name: tf.io.decode_png(parsed[name], channels=1)[..., 0] // 255 for name in ("mask", "edges")}
    image = tf.io.decode_jpeg(parsed["image"], channels=3, dct_method="INTEGER_ACCURATE")
    return parsed | {"image": image} | binary


def read_samples(folder: Path | str) -> tf.data.Dataset:
    """The pictures of a data set once, in order. Raises InputError where shards are missing."""
    contents = read_spec(folder)
    return _decode_records(tf.data.TFRecordDataset(_shard_paths(Path(folder), contents)), contents)


def shuffle_samples(
    folder: Path | str, *, seed: int, start: int = 0, count: int | None = None
) -> tf.data.Dataset:
    """The pictures of a data set, or its first `count`, again and again, shuffled anew each time.

    `start` of them are passed over. Shards are shuffled whole, then each `_AMONG` pictures in a row: enough
    for the four lighting passes over a leaf to come apart. Raises InputError where shards are missing.
    """
    contents = read_spec(folder)
    count = contents.count if count is None else min(count, contents.count)
    files = tf.constant(_shard_paths(Path(folder), contents)[: -(-count // contents.per_shard)])

    def wanted(record: tf.Tensor) -> tf.Tensor:
        schema = {"index": tf.io.FixedLenFeature([], tf.int64)}
        return tf.io.parse_single_example(record, schema)["index"] < count

    def epoch(number: tf.Tensor) -> tf.data.Dataset:
        def reordered(place: tf.Tensor, read: tf.Tensor) -> tf.data.Dataset:
            key = [seed, number * 2**20 + place + 1]
            order = tf.argsort(tf.random.stateless_uniform(tf.shape(read), key))
            return tf.data.Dataset.from_tensor_slices(tf.gather(read, order))

        order = tf.argsort(tf.random.stateless_uniform([len(files)], [seed, number * 2**20]))
        kept = tf.data.TFRecordDataset(tf.gather(files, order)).filter(wanted)
        return kept.batch(_SHUFFLE_WINDOW).enumerate().flat_map(reordered)

    first, passed = divmod(start, count)
    return _decode_records(tf.data.Dataset.range(first, 2**62).flat_map(epoch).skip(passed), contents)


def _shard_paths(folder: Path, contents: DatasetSpec) -> list[str]:
    names = [contents.name(number) for number in range(contents.shards)]
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise InputError(
            f"{folder} lacks {len(missing)} of {len(names)} shards, the first {missing[0]}; "
            "run generate again, which continues"
        )
    return [str(folder / name) for name in names]


def _decode_records(records: tf.data.Dataset, contents: DatasetSpec) -> tf.data.Dataset:
    shapes = {"image": (*contents.size, 3), "mask": contents.size, "edges": contents.size}

    def picture(record: tf.Tensor) -> dict[str, tf.Tensor]:
        found = decode_record(record)
        return found | {name: tf.ensure_shape(found[name], shape) for name, shape in shapes.items()}

    return records.map(picture, num_parallel_calls=tf.data.AUTOTUNE)


def write_samples(
    path: Path, pictures: Iterator[tuple[dict[str, np.ndarray], str]], contents: DatasetSpec
) -> None:
    """Write a shard of pictures, each with its species' name. Raises InputError as `write_shard` does."""
    encoded = (
        encode_record(picture, seed=contents.seed, prompt=species_prompt(species))
        for picture, species in pictures
    )
    write_shard(path, encoded)


def write_shard(path: Path, records: Iterable[bytes]) -> None:
    """Write `records` to `path`, whole or not at all. Raises InputError where the disk will not take them."""
    with atomic_write(path) as temporary:
        try:
            with tf.io.TFRecordWriter(str(temporary)) as file:
                for record in records:
                    file.write(record)
        except tf.errors.OpError as error:
            raise InputError(
                f"cannot write {path} ({error.message}); free space and run the command again"
            ) from None


def _bytes_feature(value: bytes) -> Any:
    return tf.train.Feature(bytes_list=tf.train.BytesList(value=[value]))


def _int_feature(value: int) -> Any:
    return tf.train.Feature(int64_list=tf.train.Int64List(value=[value]))


def _float_feature(value: np.ndarray) -> Any:
    return tf.train.Feature(float_list=tf.train.FloatList(value=np.ravel(value).tolist()))
