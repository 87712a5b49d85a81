"""Open the sources of a mixture: scenes rendered live, TFRecord data sets, photos."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.data import dataset_spec, synthetic, tfrecords
from laesi_tf.data.manifest import read_manifest
from laesi_tf.data.photo_dataset import IndexedSamples, load_into_memory, stream_from_disk
from laesi_tf.synthesis import load_ranges, synthesise

# From how many of its pictures came before to the endless stream of those that follow.
SampleStream = Callable[[int], tf.data.Dataset]


@dataclass(frozen=True)
class SourceContext:
    """What sources are opened with."""

    folder: Path
    size: tuple[int, int]
    seed: int
    masked: bool
    ranges: str
    textures: tf.Tensor | None


def _open_live(table: Mapping[str, Any], opened: SourceContext) -> SampleStream:
    ranges = table.get("ranges", opened.ranges)
    if "ranges" in table and isinstance(ranges, str) and ranges.endswith(".toml"):
        ranges = opened.folder / ranges
    chosen = load_ranges(ranges).with_passes(1)
    if "count" not in table:
        return lambda start: synthetic.synthetic_samples(
            seed=opened.seed, size=opened.size, ranges=chosen, start=start, textures=opened.textures
        )
    made = IndexedSamples(
        table["count"],
        lambda index: synthesise(
            opened.seed, size=opened.size, ranges=chosen, index=index, textures=opened.textures
        ),
    )
    return _repeat_shuffled(made, opened)


def _open_records(table: Mapping[str, Any], opened: SourceContext) -> SampleStream:
    folder = opened.folder / table.get("folder", "")
    contents = dataset_spec.read_spec(folder)
    if contents.format != "records":
        raise InputError(f"{folder} holds folders, not records; use kind photos with its manifest.csv")
    if contents.size != opened.size:
        made = "{} x {}".format(*contents.size)
        raise InputError(f"the pictures in {folder} are {made} pixels; train with that --size")
    _check_count("records", contents.count, table)
    return lambda start: tfrecords.shuffle_samples(
        folder, seed=opened.seed, start=start, count=table.get("count")
    )


def _open_photos(table: Mapping[str, Any], opened: SourceContext) -> SampleStream:
    photos = read_manifest(opened.folder / table.get("manifest", "manifest.csv"), split=table.get("split"))
    _check_count("photos", len(photos), table)
    photos = photos[: table.get("count")]
    if table.get("stream", False):
        return _repeat_shuffled(stream_from_disk(photos, size=opened.size, masked=opened.masked), opened)
    pictures, skipped = load_into_memory(photos, size=opened.size, masked=opened.masked)
    for one in skipped:
        warnings.warn(f"photo skipped: {one.reason}", stacklevel=2)
    return _repeat_shuffled(pictures, opened)


SOURCE_OPENERS: dict[str, Callable[[Mapping[str, Any], SourceContext], SampleStream]] = {
    "live": _open_live,
    "records": _open_records,
    "photos": _open_photos,
}


def _repeat_shuffled(pictures: IndexedSamples, opened: SourceContext) -> SampleStream:
    """All pictures once, then all again, in a new order each time."""

    def stream(start: int) -> tf.data.Dataset:
        def at(place: tf.Tensor) -> dict[str, tf.Tensor]:
            seed = tf.stack([opened.seed, place // pictures.count])
            return pictures.at(
                tf.random.experimental.index_shuffle(place % pictures.count, seed, pictures.count - 1)
            )

        return tf.data.Dataset.range(start, 2**62).map(at, num_parallel_calls=tf.data.AUTOTUNE)

    return stream


def _check_count(name: str, available: int, table: Mapping[str, Any]) -> None:
    if available < table.get("count", 0):
        raise InputError(f"{name}: {table['count']} pictures are asked for, but there are {available}")
