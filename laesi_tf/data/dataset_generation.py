"""Generate a data set of synthetic samples shard by shard, and continue one that was interrupted."""

import itertools
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.common.hardware import peak_rss_mb
from laesi_tf.common.progress import progress_bar
from laesi_tf.synthesis import Ranges

# isort: split
import numpy as np
import tensorflow as tf

from laesi_tf.data import dataset_spec, image_folders, synthetic, tfrecords
from laesi_tf.data.dataset_spec import DatasetSpec

Sample = dict[str, np.ndarray]
# Writes a shard of pictures, each with its species' name, whole or not at all.
ShardWriter = Callable[[Path, Iterator[tuple[Sample, str]], DatasetSpec], None]


def generate_dataset(
    contents: DatasetSpec, ranges: Ranges, out: Path, *, part: tuple[int, int] = (0, 1)
) -> dict[str, Any]:
    """Make what is missing of shards i, i + n, i + 2n, ... for `part` (i, n) of a data set in `out`.

    Returns the figures that the command prints. Raises InputError.
    """
    dataset_spec.start_dataset(out, contents)
    mine = range(part[0], contents.shards, part[1])
    missing = [shard for shard in mine if not (out / contents.name(shard)).exists()]
    begun, made = time.monotonic(), 0
    bar: Any = progress_bar([], total=sum(len(contents.pictures(shard)) for shard in missing), unit="picture")
    stream = _render_shards(contents, ranges, missing, bar)
    for shard in missing:
        _remove_partial_shard(out, contents.name(shard))
        pictures = itertools.islice(stream, len(contents.pictures(shard)))
        SHARD_WRITERS[contents.format](out / contents.name(shard), pictures, contents)
        made += len(contents.pictures(shard))
    bar.close()
    if contents.format == "folder":
        image_folders.merge_manifests(out, contents)
    seconds = time.monotonic() - begun
    return {
        "pictures": made,
        "shards": len(missing),
        "shards_already_there": len(mine) - len(missing),
        "seconds": seconds,
        "images_per_s": made / seconds if made else 0.0,
        "mb": sum(_size_bytes(out / contents.name(shard)) for shard in mine) / 1e6,
        "peak_rss_mb": peak_rss_mb(),
    }


def _remove_partial_shard(out: Path, name: str) -> None:
    """Remove what a killed run left of a shard."""
    for left in out.glob(f".{Path(name).stem}-*"):
        shutil.rmtree(left) if left.is_dir() else left.unlink()


def _render_shards(
    contents: DatasetSpec, ranges: Ranges, shards: Sequence[int], bar: Any
) -> Iterator[tuple[Sample, str]]:
    """The pictures of `shards` with their species' names, from one graph: tracing it takes seconds."""
    kinds = tuple(ranges.leaf)
    wanted = {index for shard in shards for index in contents.pictures(shard)}
    leaves = sorted({index // ranges.lighting_passes for index in wanted})
    stream = synthetic.samples_of_leaves(
        tf.data.Dataset.from_tensor_slices(np.array(leaves, np.int64)),
        seed=contents.seed,
        size=contents.size,
        ranges=ranges,
    )
    for picture in stream.prefetch(8).as_numpy_iterator():
        # A leaf whose passes end in another shard is made for both.
        if int(picture["index"]) in wanted:
            yield picture, kinds[picture["kind"]]
            bar.update()


SHARD_WRITERS: dict[str, ShardWriter] = {
    "records": tfrecords.write_samples,
    "folder": image_folders.write_shard_folder,
}


def _size_bytes(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
