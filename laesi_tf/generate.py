"""Generate a data set of synthetic images: the paper's 100,000, or any number.

It is stored as TFRecord shards (see laesi_tf.data.tfrecords) or, for other programs than TensorFlow, as
folders of JPEG and PNG with a manifest.csv. Run the command again to continue after a stop; it also checks
the shards that exist and replaces damaged ones. n machines with --shard 0/n to n-1/n together write the same
files as one machine alone.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.dataset_arguments import add_ranges_argument, add_shard_argument
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.parsing import image_size, non_negative_int, positive_int
from laesi_tf.data.dataset_spec import FORMATS, SPEC_FILE, DatasetSpec


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    require_writable(options.out / SPEC_FILE)
    load_tensorflow()
    from laesi_tf.data.dataset_generation import generate_dataset
    from laesi_tf.synthesis import SYNTHESIS_VERSION, load_ranges
    from laesi_tf.synthesis.ranges_toml import ranges_to_toml

    # A data set is labelled with areas, which an empty sheet lacks.
    ranges = load_ranges(options.ranges).without_empty_sheets()
    spec = DatasetSpec(
        count=options.count,
        size=options.size,
        per_shard=options.per_shard,
        seed=options.seed,
        format=options.format,
        ranges=ranges_to_toml(ranges),
        grid_mm=None if ranges.has("paper_kinds") else 1.0,
        synthesis_version=SYNTHESIS_VERSION,
    )
    metrics = generate_dataset(spec, ranges, options.out, shard_fraction=options.shard)
    if options.json is not None:
        write_json(options.json, metrics)
    print(_format_summary(metrics, options.out))


def _format_summary(metrics: Mapping[str, Any], out: Path) -> str:
    present = metrics["shards_already_there"]
    return (
        "{pictures} images in {shards} shards, {seconds:.0f} s at {images_per_s:.0f} images/s, "
        "peak memory {peak_rss_mb:.0f} MB, size {mb:.0f} MB".format_map(metrics)
        + (f"; {present} shards existed already" if present else "")
        + f": {out}"
    )


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("generate", __doc__)
    parser.add_argument(
        "--count", type=positive_int, required=True, metavar="N", help="images in the data set"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the data set")
    parser.add_argument(
        "--size", type=image_size, default=(224, 224), metavar="PX", help="SIDE or HEIGHTxWIDTH in pixels"
    )
    parser.add_argument(
        "--seed",
        type=non_negative_int,
        default=0,
        help="seed of the scenes; a data set that tests a model needs another seed than its training data",
    )
    add_ranges_argument(parser)
    parser.add_argument("--format", choices=FORMATS, default="records", help="TFRecord, or JPEG and PNG")
    parser.add_argument("--per-shard", type=positive_int, default=1000, metavar="N", help="images in a shard")
    add_shard_argument(parser, verb="generate")
    return parser


if __name__ == "__main__":
    run_command(main)
