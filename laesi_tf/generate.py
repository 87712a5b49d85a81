"""Make a data set of synthetic pictures: the paper's 100,000, or as many as are asked for.

As TFRecord shards (see laesi_tf.data.records) or, for those who do not use TensorFlow, as folders of JPEG and
PNG with a manifest.csv. Run the command again to continue where it was stopped. n machines with --shard 0/n
to n-1/n make together, file by file, what one makes alone.
"""

import argparse
import itertools
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli import parser, positive, progress, run, size
from laesi_tf.synthesis import Ranges, load_ranges
from laesi_tf.synthesis.ranges_toml import ranges_to_toml

# isort: split
import numpy as np
import tensorflow as tf

from laesi_tf.data import folders, records, synthetic
from laesi_tf.data.records import Contents
from laesi_tf.files import require_writable, write_json
from laesi_tf.machine import peak_rss_mb

Picture = dict[str, np.ndarray]
# Writes a shard of pictures, each with its species' name, whole or not at all.
Write = Callable[[Path, Iterator[tuple[Picture, str]], Contents], None]


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _parser().parse_args(arguments)
    if options.json is not None:
        require_writable(options.json)
    ranges = load_ranges(options.ranges)
    contents = Contents(
        count=options.count,
        size=options.size,
        per_shard=options.per_shard,
        seed=options.seed,
        format=options.format,
        ranges=ranges_to_toml(ranges),
    )
    figures = generate(contents, ranges, options.out, part=options.shard)
    if options.json is not None:
        write_json(options.json, figures)
    print(_summary(figures, options.out))


def generate(
    contents: Contents, ranges: Ranges, out: Path, *, part: tuple[int, int] = (0, 1)
) -> dict[str, Any]:
    """Make what is missing of shards i, i + n, i + 2n, ... for `part` (i, n) of a data set in `out`.

    Returns the figures that the command prints. Raises InputError.
    """
    records.begin(out, contents)
    mine = range(part[0], contents.shards, part[1])
    missing = [shard for shard in mine if not (out / contents.name(shard)).exists()]
    begun, made = time.monotonic(), 0
    bar: Any = progress([], total=sum(len(contents.pictures(shard)) for shard in missing), unit="picture")
    stream = _pictures(contents, ranges, missing, bar)
    for shard in missing:
        _clear(out, contents.name(shard))
        pictures = itertools.islice(stream, len(contents.pictures(shard)))
        WRITERS[contents.format](out / contents.name(shard), pictures, contents)
        made += len(contents.pictures(shard))
    bar.close()
    if contents.format == "folder":
        folders.join_manifests(out, contents)
    seconds = time.monotonic() - begun
    return {
        "pictures": made,
        "shards": len(missing),
        "shards_already_there": len(mine) - len(missing),
        "seconds": seconds,
        "images_per_s": made / seconds if made else 0.0,
        "mb": sum(_bytes(out / contents.name(shard)) for shard in mine) / 1e6,
        "peak_rss_mb": peak_rss_mb(),
    }


def _clear(out: Path, name: str) -> None:
    """Remove what a killed run left of a shard."""
    for left in out.glob(f".{Path(name).stem}-*"):
        shutil.rmtree(left) if left.is_dir() else left.unlink()


def _pictures(
    contents: Contents, ranges: Ranges, shards: Sequence[int], bar: Any
) -> Iterator[tuple[Picture, str]]:
    """The pictures of `shards` with their species' names, from one graph: tracing it takes seconds."""
    kinds = tuple(ranges.leaf)
    wanted = {index for shard in shards for index in contents.pictures(shard)}
    leaves = sorted({index // ranges.lighting_passes for index in wanted})
    stream = synthetic.pictures_of(
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


WRITERS: dict[str, Write] = {"records": records.write_pictures, "folder": folders.write_pictures}


def _bytes(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _summary(figures: dict[str, Any], out: Path) -> str:
    there = figures["shards_already_there"]
    return (
        "{pictures} pictures in {shards} shards, {seconds:.0f} s at {images_per_s:.0f} images/s, "
        "peak memory {peak_rss_mb:.0f} MB; the part is {mb:.0f} MB".format_map(figures)
        + (f"; {there} shards were there already" if there else "")
        + f": {out}"
    )


def _parser() -> argparse.ArgumentParser:
    made = parser("generate", __doc__)
    made.add_argument("--count", type=positive, required=True, metavar="N", help="pictures in the data set")
    made.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the data set")
    made.add_argument("--size", type=size, default=(224, 224), metavar="PX", help="SIDE or HEIGHTxWIDTH")
    made.add_argument(
        "--seed",
        type=int,
        default=0,
        help="seed of the scenes; what is to test a model needs another than it was trained with",
    )
    made.add_argument("--ranges", default="rendering_2", metavar="PRESET|FILE", help="where scenes come from")
    made.add_argument("--format", choices=tuple(WRITERS), default="records", help="TFRecord, or JPEG and PNG")
    made.add_argument("--per-shard", type=positive, default=1000, metavar="N", help="pictures in a shard")
    made.add_argument(
        "--shard", type=_part, default=(0, 1), metavar="I/N", help="make one of n parts, from 0/n"
    )
    return made


def _part(text: str) -> tuple[int, int]:
    index, _, parts = text.partition("/")
    if not (index.isdigit() and parts.isdigit() and int(index) < int(parts)):
        raise argparse.ArgumentTypeError(f"{text!r} is not I/N with I from 0 to N - 1")
    return int(index), int(parts)


if __name__ == "__main__":
    run(main)
