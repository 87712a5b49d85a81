"""Arguments and reports that benchmarks share."""

import argparse
from collections.abc import Mapping
from typing import Any

from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.parsing import image_size, non_negative_int


def report_figures(options: argparse.Namespace, metrics: Mapping[str, Any], text: str) -> None:
    """Write the figures where --json says, and print them as `text`."""
    if options.json is not None:
        write_json(options.json, metrics)
    print(text)


def add_photo_arguments(parser: argparse.ArgumentParser, *, use: str) -> None:
    """Add the photos that a benchmark measures; `use` says what for."""
    parser.add_argument("photos", nargs="+", metavar="PHOTO", help=f"photos or folders{use}")


def add_scene_arguments(parser: argparse.ArgumentParser, *, size: tuple[int, int]) -> None:
    """Add seed and size of scenes; `size` is the default."""
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of the scenes")
    parser.add_argument(
        "--size", type=image_size, default=size, metavar="PX", help="SIDE or HEIGHTxWIDTH in pixels"
    )
