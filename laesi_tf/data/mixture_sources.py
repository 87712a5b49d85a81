"""The sources of a mixture: scenes rendered live, TFRecord data sets, photos.

Each source is a dataclass of the keys of its table in the TOML file and opens itself; a new one is added to
SOURCE_TYPES.
"""

import abc
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import check_fields, option
from laesi_tf.data import synthetic
from laesi_tf.data.dataset_spec import read_spec
from laesi_tf.data.manifest import MANIFEST_FILE, read_manifest
from laesi_tf.data.photo_dataset import IndexedSamples, load_into_memory, stream_from_disk
from laesi_tf.data.sample import Sample
from laesi_tf.data.tfrecords import check_shards, shuffle_samples
from laesi_tf.synthesis import load_ranges, synthesise

SampleStream = Callable[[int], tf.data.Dataset]
"""From the number of samples already used to the endless stream of those that follow."""


@dataclass(frozen=True)
class SourceContext:
    """What all sources of a mixture are opened with; `folder` is that of the TOML file."""

    folder: Path
    size: tuple[int, int]
    seed: int
    needs_masks: bool
    needs_leaf: bool
    ranges: str
    textures: tf.Tensor | None


def _parse_count(value: Any) -> int | None:
    if value is not None and (type(value) is not int or value < 0):
        raise ValueError("a whole number from 0 up")
    return value


def _parse_weight(value: Any) -> float | None:
    if value is not None and (type(value) not in (int, float) or not 0 <= value < math.inf):
        raise ValueError("a number from 0 up")
    return value


def _parse_ranges(value: Any) -> Any:
    if not isinstance(value, str | dict):
        raise ValueError("the name of a preset, a TOML file or a table")
    return value


@dataclass(frozen=True, kw_only=True)
class SourceOptions(abc.ABC):
    """Keys that every source has. Raises InputError for a value of the wrong type or out of range."""

    kind: str = option()
    weight: float | None = option(None, "share of the stream", parse=_parse_weight)
    count: int | None = option(None, "share, and number of different samples", parse=_parse_count)

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def share(self) -> float:
        """Share of the stream, not normalised."""
        return float(self.weight or self.count or 0)

    @abc.abstractmethod
    def open(self, context: SourceContext) -> SampleStream:
        """Open the source. Raises InputError."""

    def check_count(self, available: int) -> None:
        """Raise InputError if the source has fewer samples than `count`."""
        if available < (self.count or 0):
            raise InputError(f"{self.kind}: count is {self.count}, but there are {available} samples")


@dataclass(frozen=True, kw_only=True)
class LiveSource(SourceOptions):
    """Scenes that are rendered during training."""

    ranges: Any = option("", "scene ranges; empty: those of the run", parse=_parse_ranges)

    def open(self, context: SourceContext) -> SampleStream:
        """Render endlessly new scenes, or with a `count` the same ones again and again."""
        ranges = self.ranges or context.ranges
        if self.ranges and isinstance(ranges, str) and ranges.endswith(".toml"):
            ranges = context.folder / ranges
        scene_ranges = load_ranges(ranges).with_passes(1)
        if context.needs_leaf:
            scene_ranges = scene_ranges.without_empty_sheets()
        options: dict[str, Any] = {
            "size": context.size,
            "ranges": scene_ranges,
            "textures": context.textures,
        }
        if self.count is None:
            return lambda start: synthetic.synthetic_samples(seed=context.seed, start=start, **options)
        scenes = IndexedSamples(self.count, lambda index: synthesise(context.seed, index=index, **options))
        return _repeat_shuffled(scenes, context)


@dataclass(frozen=True, kw_only=True)
class RecordsSource(SourceOptions):
    """A data set of TFRecords that `generate` wrote."""

    folder: str = option("", "folder of the data set")

    def open(self, context: SourceContext) -> SampleStream:
        """Read the data set endlessly, in a new order each time."""
        folder = context.folder / self.folder
        spec = read_spec(folder)
        if spec.format != "records":
            raise InputError(f"{folder} holds folders, not records; use kind photos with its {MANIFEST_FILE}")
        if spec.size != context.size:
            size = "{} x {}".format(*spec.size)
            raise InputError(f"the images in {folder} are {size} pixels; train with that --size")
        self.check_count(spec.count)
        check_shards(folder, spec)
        return lambda start: shuffle_samples(folder, seed=context.seed, start=start, count=self.count)


@dataclass(frozen=True, kw_only=True)
class PhotosSource(SourceOptions):
    """Photos of a manifest."""

    manifest: str = option(MANIFEST_FILE, "CSV file that lists the photos")
    split: str = option("", "split of the manifest; empty: all photos")
    stream: bool = option(False, "decode photos each time instead of keeping them in memory")

    def open(self, context: SourceContext) -> SampleStream:
        """Use all photos once, then again in a new order."""
        photos = read_manifest(context.folder / self.manifest, split=self.split or None)
        self.check_count(len(photos))
        photos = photos[: self.count]
        options: dict[str, Any] = {"size": context.size, "needs_masks": context.needs_masks}
        if self.stream:
            return _repeat_shuffled(stream_from_disk(photos, **options), context)
        samples, skipped = load_into_memory(photos, **options)
        for photo in skipped:
            warnings.warn(f"photo skipped: {photo.reason}", stacklevel=2)
        return _repeat_shuffled(samples, context)


SOURCE_TYPES: dict[str, type[SourceOptions]] = {
    "live": LiveSource,
    "records": RecordsSource,
    "photos": PhotosSource,
}
"""Values of `kind` in a mixture file."""


def _repeat_shuffled(samples: IndexedSamples, context: SourceContext) -> SampleStream:
    """Stream all samples once, then all again, in a new order each time."""

    def stream(start: int) -> tf.data.Dataset:
        def get_at_position(position: tf.Tensor) -> Sample:
            seed = tf.stack([context.seed, position // samples.count])
            index = tf.random.experimental.index_shuffle(position % samples.count, seed, samples.count - 1)
            return samples.get(index)

        positions = tf.data.Dataset.range(start, 2**62)
        return positions.map(get_at_position, num_parallel_calls=tf.data.AUTOTUNE)

    return stream
