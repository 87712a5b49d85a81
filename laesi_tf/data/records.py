"""Pictures as TFRecord shards: a data set that is made once and read many times.

A data set is a folder: `dataset.json` says what it holds, and `pictures-00003-of-00100.tfrecord` is one of
its shards. A record is a tf.train.Example of

image      JPEG of quality 95 without colour subsampling      area_cm2, px_per_mm, tilt_deg   float
mask       PNG, 0 and 255                                      to_px                           9 floats
edges      PNG, Canny edges of the mask                        seed, index                     int64
prompt     text for an image generator, UTF-8
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tensorflow as tf

from laesi_tf.errors import InputError
from laesi_tf.files import whole, write_json

MANIFEST = "dataset.json"
_NUMBERS = {"area_cm2": (), "px_per_mm": (), "tilt_deg": (), "to_px": (3, 3)}
_JPEG_QUALITY = 95
_AMONG = 2000


@dataclass(frozen=True, kw_only=True)
class Contents:
    """What a data set holds: `count` pictures of `size` (height, width), `per_shard` of them in a shard."""

    count: int
    size: tuple[int, int]
    per_shard: int
    seed: int
    format: str = "records"
    """"records", or "folder" where shards are those of `laesi_tf.data.folders`."""
    ranges: str
    """All that the scenes are drawn from, as TOML."""

    @property
    def shards(self) -> int:
        """How many shards make the data set."""
        return -(-self.count // self.per_shard)

    def pictures(self, shard: int) -> range:
        """Indices of the pictures in a shard."""
        return range(shard * self.per_shard, min((shard + 1) * self.per_shard, self.count))

    def name(self, shard: int) -> str:
        """Name of a shard's file or folder."""
        suffix = ".tfrecord" if self.format == "records" else ""
        return f"pictures-{shard:05}-of-{self.shards:05}{suffix}"


def begin(folder: Path, contents: Contents) -> None:
    """Write what the data set in `folder` is to hold; InputError if another one has begun there."""
    path = folder / MANIFEST
    if path.is_file():
        if read_contents(folder) != contents:
            raise InputError(f"{folder} holds another data set; continue it as it was begun or name another")
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder} is neither empty nor a data set; name another folder")
    write_json(path, asdict(contents))


def read_contents(folder: Path | str) -> Contents:
    """What the data set in `folder` is to hold. Raises InputError."""
    path = Path(folder) / MANIFEST
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        return Contents(**values | {"size": tuple(values["size"])})
    except OSError as error:
        raise InputError(
            f"no data set in {folder}: {MANIFEST}: {error.strerror}; make one with generate"
        ) from None
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path} is broken ({error}); make the data set again") from None


def encode(picture: Mapping[str, np.ndarray], *, seed: int, prompt: str) -> bytes:
    """One record of a picture with image uint8 [H, W, 3], mask uint8 [H, W] 0/1, its numbers and its index.

    The same picture always gives the same bytes.
    """
    features = {
        "image": _bytes(jpeg(picture["image"])),
        "mask": _bytes(png(picture["mask"] * 255)),
        "edges": _bytes(png(edges(picture["mask"]))),
        "prompt": _bytes(prompt.encode()),
        "seed": _integer(seed),
        "index": _integer(int(picture["index"])),
        **{name: _floats(picture[name]) for name in _NUMBERS},
    }
    # Protocol buffers leave the order of a map open unless they are asked for one.
    example = tf.train.Example(features=tf.train.Features(feature=features))
    return example.SerializeToString(deterministic=True)


def decode(record: tf.Tensor) -> dict[str, tf.Tensor]:
    """The picture in a record, string []: as `encode` took it, with `edges` uint8 [H, W] 0/1 besides."""
    schema = {name: tf.io.FixedLenFeature([], tf.string) for name in ("image", "mask", "edges", "prompt")}
    schema |= {name: tf.io.FixedLenFeature([], tf.int64) for name in ("seed", "index")}
    schema |= {name: tf.io.FixedLenFeature(shape, tf.float32) for name, shape in _NUMBERS.items()}
    parsed = tf.io.parse_single_example(record, schema)
    binary = {name: tf.io.decode_png(parsed[name], channels=1)[..., 0] // 255 for name in ("mask", "edges")}
    image = tf.io.decode_jpeg(parsed["image"], channels=3, dct_method="INTEGER_ACCURATE")
    return parsed | {"image": image} | binary


def read(folder: Path | str) -> tf.data.Dataset:
    """The pictures of a data set once, in order. Raises InputError where shards are missing."""
    contents = read_contents(folder)
    return _decoded(tf.data.TFRecordDataset(_files(Path(folder), contents)), contents)


def shuffled(folder: Path | str, *, seed: int, start: int = 0, count: int | None = None) -> tf.data.Dataset:
    """The pictures of a data set, or its first `count`, again and again, shuffled anew each time.

    `start` of them are passed over. Shards are shuffled whole, then each `_AMONG` pictures in a row: enough
    for the four lighting passes over a leaf to come apart. Raises InputError where shards are missing.
    """
    contents = read_contents(folder)
    count = contents.count if count is None else min(count, contents.count)
    files = tf.constant(_files(Path(folder), contents)[: -(-count // contents.per_shard)])

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
        return kept.batch(_AMONG).enumerate().flat_map(reordered)

    first, passed = divmod(start, count)
    return _decoded(tf.data.Dataset.range(first, 2**62).flat_map(epoch).skip(passed), contents)


def _files(folder: Path, contents: Contents) -> list[str]:
    names = [contents.name(number) for number in range(contents.shards)]
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise InputError(
            f"{folder} lacks {len(missing)} of {len(names)} shards, the first {missing[0]}; "
            "run generate again, which continues"
        )
    return [str(folder / name) for name in names]


def _decoded(records: tf.data.Dataset, contents: Contents) -> tf.data.Dataset:
    shapes = {"image": (*contents.size, 3), "mask": contents.size, "edges": contents.size}

    def picture(record: tf.Tensor) -> dict[str, tf.Tensor]:
        found = decode(record)
        return found | {name: tf.ensure_shape(found[name], shape) for name, shape in shapes.items()}

    return records.map(picture, num_parallel_calls=tf.data.AUTOTUNE)


def write_pictures(
    path: Path, pictures: Iterator[tuple[dict[str, np.ndarray], str]], contents: Contents
) -> None:
    """Write a shard of pictures, each with its species' name. Raises InputError as `write_shard` does."""
    encoded = (encode(picture, seed=contents.seed, prompt=prompt(species)) for picture, species in pictures)
    write_shard(path, encoded)


def prompt(species: str) -> str:
    """What the paper asks ControlNet for (section "Integration of ControlNet Inpainting")."""
    return f"{species} leaf on millimeter paper"


def write_shard(path: Path, records: Iterable[bytes]) -> None:
    """Write `records` to `path`, whole or not at all. Raises InputError where the disk will not take them."""
    with whole(path) as temporary:
        try:
            with tf.io.TFRecordWriter(str(temporary)) as file:
                for record in records:
                    file.write(record)
        except tf.errors.OpError as error:
            raise InputError(
                f"cannot write {path} ({error.message}); free space and run the command again"
            ) from None


def edges(mask: np.ndarray) -> np.ndarray:
    """Canny edges uint8 [H, W] 0/255 of a mask [H, W] 0/1: what ControlNet is conditioned on."""
    return cv2.Canny(mask * 255, 100, 200)


def jpeg(image: np.ndarray) -> bytes:
    """JPEG of an image uint8 [H, W, 3]: halved colour would blur the ruling's ink."""
    return tf.io.encode_jpeg(image, quality=_JPEG_QUALITY, chroma_downsampling=False).numpy()


def png(field: np.ndarray) -> bytes:
    """PNG of a field uint8 [H, W]."""
    return tf.io.encode_png(field[..., None]).numpy()


def _bytes(value: bytes) -> Any:
    return tf.train.Feature(bytes_list=tf.train.BytesList(value=[value]))


def _integer(value: int) -> Any:
    return tf.train.Feature(int64_list=tf.train.Int64List(value=[value]))


def _floats(value: np.ndarray) -> Any:
    return tf.train.Feature(float_list=tf.train.FloatList(value=np.ravel(value).tolist()))
