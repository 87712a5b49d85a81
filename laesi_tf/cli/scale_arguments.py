"""The options that say what the scale of photos is, and the check that each has an effect."""

import argparse
import tomllib
from pathlib import Path

from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_float
from laesi_tf.common.run_files import CONFIG_FILE, LITERT_SUFFIX
from laesi_tf.common.units import MM_PER_INCH

OF_FILE = "file"
"""Value of --dpi that takes the resolution in each file's header."""


def add_scale_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --px-per-mm, --dpi and --grid-mm."""
    parser.add_argument(
        "--px-per-mm",
        type=positive_float,
        metavar="N",
        help="scale of all photos in pixels per mm: every leaf is measured with it, and no ruling is read",
    )
    parser.add_argument(
        "--dpi",
        type=_dpi,
        metavar="N|file",
        help="the same in dots per inch, for scans: a number, or `file` for the resolution in each file's "
        "header, which is refused where it is 72 or 96, as programs write by default",
    )
    parser.add_argument(
        "--grid-mm",
        type=positive_float,
        metavar="MM",
        help="distance between the finest lines of the paper (default: millimetres, if heavier lines say so)",
    )


def has_known_scale(options: argparse.Namespace) -> bool:
    """Return whether the user gives the scale."""
    return options.px_per_mm is not None or options.dpi is not None


def scale_px_per_mm(options: argparse.Namespace) -> float | None:
    """Return the scale of all photos; None if it is not given, or that of each file."""
    if isinstance(options.dpi, float):
        return options.dpi / MM_PER_INCH
    return options.px_per_mm


def check_scale_options(options: argparse.Namespace) -> None:
    """Raise InputError for an option that would have no effect beside the others."""
    if options.px_per_mm is not None and options.dpi is not None:
        raise InputError("--px-per-mm and --dpi both give the scale; leave out one of them")
    # An exported file says itself whether it reads rulings.
    is_file = options.model is not None and options.model.suffix == LITERT_SUFFIX
    reads_ruling = options.model is None or options.guess or is_file
    if options.grid_mm is not None and not reads_ruling:
        raise InputError(f"--grid-mm has no effect with --model {options.model}, which reads no ruling")
    if not has_known_scale(options):
        return
    name = "--px-per-mm" if options.dpi is None else "--dpi"
    for other in ("ruling_model", "grid_mm", "guess"):
        if getattr(options, other):
            raise InputError(
                f"--{other.replace('_', '-')} has no effect with {name}, which reads no ruling; "
                "leave out one of them"
            )
    if options.model is not None and _read_task(options.model) == "area":
        raise InputError(
            f"{name} has no effect with --model {options.model}, an area model, which takes no scale; "
            "leave out one of them"
        )


def _dpi(text: str) -> float | str:
    if text == OF_FILE:
        return OF_FILE
    try:
        return positive_float(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}, nor `{OF_FILE}`") from None


def _read_task(run: Path) -> str | None:
    """Return the task of the run in a folder; None where that cannot be read, which loading it reports."""
    try:
        return tomllib.loads((run / CONFIG_FILE).read_text(encoding="utf-8")).get("task")
    except (OSError, ValueError):
        return None
