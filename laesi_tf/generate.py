"""Make a data set of synthetic pictures: the paper's 100,000, or as many as are asked for.

As TFRecord shards (see laesi_tf.data.tfrecords) or, for those who do not use TensorFlow, as folders of JPEG and
PNG with a manifest.csv. Run the command again to continue where it was stopped. n machines with --shard 0/n
to n-1/n make together, file by file, what one makes alone.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.parsing import image_size, positive_int
from laesi_tf.synthesis import load_ranges
from laesi_tf.synthesis.ranges_toml import ranges_to_toml

# isort: split
from laesi_tf.data.dataset_generation import SHARD_WRITERS, generate_dataset
from laesi_tf.data.dataset_spec import DatasetSpec


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    if options.json is not None:
        require_writable(options.json)
    ranges = load_ranges(options.ranges)
    contents = DatasetSpec(
        count=options.count,
        size=options.size,
        per_shard=options.per_shard,
        seed=options.seed,
        format=options.format,
        ranges=ranges_to_toml(ranges),
    )
    figures = generate_dataset(contents, ranges, options.out, part=options.shard)
    if options.json is not None:
        write_json(options.json, figures)
    print(_format_summary(figures, options.out))


def _format_summary(figures: dict[str, Any], out: Path) -> str:
    there = figures["shards_already_there"]
    return (
        "{pictures} pictures in {shards} shards, {seconds:.0f} s at {images_per_s:.0f} images/s, "
        "peak memory {peak_rss_mb:.0f} MB; the part is {mb:.0f} MB".format_map(figures)
        + (f"; {there} shards were there already" if there else "")
        + f": {out}"
    )


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("generate", __doc__)
    made.add_argument(
        "--count", type=positive_int, required=True, metavar="N", help="pictures in the data set"
    )
    made.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the data set")
    made.add_argument(
        "--size", type=image_size, default=(224, 224), metavar="PX", help="SIDE or HEIGHTxWIDTH"
    )
    made.add_argument(
        "--seed",
        type=int,
        default=0,
        help="seed of the scenes; what is to test a model needs another than it was trained with",
    )
    made.add_argument("--ranges", default="rendering_2", metavar="PRESET|FILE", help="where scenes come from")
    made.add_argument(
        "--format", choices=tuple(SHARD_WRITERS), default="records", help="TFRecord, or JPEG and PNG"
    )
    made.add_argument("--per-shard", type=positive_int, default=1000, metavar="N", help="pictures in a shard")
    made.add_argument(
        "--shard",
        type=_parse_shard_fraction,
        default=(0, 1),
        metavar="I/N",
        help="make one of n parts, from 0/n",
    )
    return made


def _parse_shard_fraction(text: str) -> tuple[int, int]:
    index, _, parts = text.partition("/")
    if not (index.isdigit() and parts.isdigit() and int(index) < int(parts)):
        raise argparse.ArgumentTypeError(f"{text!r} is not I/N with I from 0 to N - 1")
    return int(index), int(parts)


if __name__ == "__main__":
    run_command(main)
