"""The options of `predict` that say which files it writes, and how."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import output_file
from laesi_tf.common.errors import InputError
from laesi_tf.common.result_files import OVERLAY_SIDE_PX

_OVERLAY_LIMITS = 200, 20_000


def add_output_arguments(parser: argparse.ArgumentParser, *, csv_formats: Sequence[str]) -> None:
    """Add the options of the folder of results, its tables and overlays."""
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("predictions"),
        metavar="DIR",
        help="folder for areas.csv, overlays and report.html",
    )
    parser.add_argument(
        "--again", action="store_true", help="measure all photos anew, also those that have not changed"
    )
    parser.add_argument(
        "--csv",
        choices=tuple(csv_formats),
        help="dialect of areas.csv: `excel` begins with a byte order mark, `decimal-comma` has semicolons "
        "and decimal commas, too (default: that of the folder, which begins with `standard`)",
    )
    parser.add_argument(
        "--jsonl", type=output_file, metavar="FILE", help="also write a JSON object per leaf and line to FILE"
    )
    parser.add_argument(
        "--names",
        type=Path,
        metavar="FILE",
        help="CSV of two columns, file and sample: the column `sample` of the tables (default: the list that "
        "the folder was last given)",
    )
    parser.add_argument(
        "--overlay-size",
        type=_overlay_side,
        metavar="PX",
        help=f"longer side of the overlays in pixels (default: {OVERLAY_SIDE_PX})",
    )
    parser.add_argument("--no-overlay", action="store_true", help="write no overlays")


def overlay_side(options: argparse.Namespace) -> int | None:
    """Return the longer side of overlays in pixels; None for none. Raises InputError for a contradiction."""
    if options.no_overlay:
        if options.overlay_size is not None:
            raise InputError("--overlay-size has no effect with --no-overlay; leave out one of them")
        return None
    return OVERLAY_SIDE_PX if options.overlay_size is None else int(options.overlay_size)


def _overlay_side(text: str) -> int:
    low, high = _OVERLAY_LIMITS
    if not text.isdecimal() or not low <= int(text) <= high:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of pixels from {low} to {high}")
    return int(text)
