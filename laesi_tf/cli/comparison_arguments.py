"""The options of commands that compare methods on sets of photos."""

import argparse
from pathlib import Path


def add_photo_set_arguments(parser: argparse.ArgumentParser, *, required: bool) -> None:
    """Add --photos, for `data.manifest.read_photo_sets`."""
    parser.add_argument(
        "--photos",
        nargs="+",
        action="append",
        default=[],
        required=required,
        metavar=("CSV", "SPLIT"),
        help="manifest of photos of known area, and the split to take of it; may be given several times",
    )


def add_method_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --models and --methods."""
    parser.add_argument(
        "--models",
        nargs="+",
        type=Path,
        default=[],
        metavar="RUN|FILE.tflite",
        help="further models to compare: training runs that measure alone, files that export wrote",
    )
    parser.add_argument(
        "--methods",
        nargs="+",
        default=[],
        metavar="NAME",
        help="only these methods (default: all)",
    )
