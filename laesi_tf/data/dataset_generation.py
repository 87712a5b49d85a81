"""Generate a data set of synthetic samples shard by shard, and continue one that was interrupted."""

import itertools
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.common.hardware import peak_rss_mb
from laesi_tf.common.progress import progress_bar
from laesi_tf.data import image_folders, synthetic, tfrecords
from laesi_tf.data.dataset_spec import DatasetSpec, start_dataset
from laesi_tf.data.sample import ArraySample
from laesi_tf.synthesis import Ranges


@dataclass(frozen=True)
class ShardFormat:
    """How shards are stored: `write` a shard completely or not at all; `find_damage` in one."""

    write: Callable[[Path, Iterator[tuple[ArraySample, str]], DatasetSpec], None]
    find_damage: Callable[..., str | None]


SHARD_FORMATS = {
    "records": ShardFormat(tfrecords.write_samples, tfrecords.find_damage),
    "folder": ShardFormat(image_folders.write_shard_folder, image_folders.find_folder_damage),
}


def generate_dataset(
    spec: DatasetSpec, ranges: Ranges, out: Path, *, shard_fraction: tuple[int, int] = (0, 1)
) -> dict[str, Any]:
    """Generate what is missing of shards i, i + n, i + 2n, ... for `shard_fraction` (i, n) of a data set.

    A damaged shard is named in a warning and generated again. Returns the metrics that the command prints.
    Raises InputError.
    """
    start_dataset(out, spec)
    shard_format = SHARD_FORMATS[spec.format]
    shards = range(shard_fraction[0], spec.shards, shard_fraction[1])
    missing = find_missing_shards(shards, spec, out, remedy="generated again")
    started, generated = time.monotonic(), 0
    total = sum(len(spec.sample_indices(shard)) for shard in missing)
    bar: Any = progress_bar([], total=total, unit="image")
    samples = _render_shards(spec, ranges, missing, bar)
    for shard in missing:
        path, count = out / spec.shard_name(shard), len(spec.sample_indices(shard))
        remove_partial_shard(path)
        shard_format.write(path, itertools.islice(samples, count), spec)
        generated += count
    bar.close()
    if spec.format == "folder":
        image_folders.merge_manifests(out, spec)
    seconds = time.monotonic() - started
    return {
        "pictures": generated,
        "shards": len(missing),
        "shards_already_there": len(shards) - len(missing),
        "seconds": seconds,
        "images_per_s": generated / seconds if generated else 0.0,
        "mb": sum(size_bytes(out / spec.shard_name(shard)) for shard in shards) / 1e6,
        "peak_rss_mb": peak_rss_mb(),
    }


def find_missing_shards(shards: Sequence[int], spec: DatasetSpec, out: Path, *, remedy: str) -> list[int]:
    """Return the shards that do not exist or are damaged; remove the damaged ones.

    A warning names each damaged shard and says that it is `remedy`, such as "generated again".
    """
    missing = []
    for shard in progress_bar(shards, desc="checking", unit="shard"):
        path = out / spec.shard_name(shard)
        if not path.exists():
            missing.append(shard)
            continue
        damage = SHARD_FORMATS[spec.format].find_damage(path, count=len(spec.sample_indices(shard)))
        if damage is not None:
            warnings.warn(f"{path} is damaged and is {remedy}: {damage}", stacklevel=3)
            _remove(path)
            missing.append(shard)
    return missing


def remove_partial_shard(path: Path) -> None:
    """Remove temporary files that a killed process left beside a shard."""
    for partial in path.parent.glob(f".{path.stem}-*"):
        _remove(partial)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()


def _render_shards(
    spec: DatasetSpec, ranges: Ranges, shards: Sequence[int], bar: Any
) -> Iterator[tuple[ArraySample, str]]:
    """Render the samples of all `shards`, with their species, in one graph: tracing it takes seconds."""
    species = tuple(ranges.leaf)
    indices = {index for shard in shards for index in spec.sample_indices(shard)}
    leaves = sorted({index // ranges.lighting_passes for index in indices})
    samples = synthetic.samples_of_leaves(
        tf.data.Dataset.from_tensor_slices(np.array(leaves, np.int64)),
        seed=spec.seed,
        size=spec.size,
        ranges=ranges,
    )
    for sample in samples.prefetch(8).as_numpy_iterator():
        # The lighting passes of a leaf may belong to two shards.
        if int(sample["index"]) in indices:
            yield sample, species[sample["kind"]]
            bar.update()


def size_bytes(path: Path) -> int:
    """Return the size of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
