"""The options of commands that compare methods on sets of photos."""

import argparse
from pathlib import Path

from laesi_tf.common.errors import InputError


def add_photo_set_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --photos."""
    parser.add_argument(
        "--photos",
        nargs="+",
        action="append",
        default=[],
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


def parse_photo_sets(options: argparse.Namespace) -> dict[str, tuple[Path, str | None]]:
    """Return manifest and split of each set by its name, folder and split. Raises InputError."""
    sets: dict[str, tuple[Path, str | None]] = {}
    for manifest, *splits in options.photos:
        if len(splits) > 1:
            raise InputError(f"--photos {manifest} takes one split; give --photos again for another")
        path = Path(manifest)
        name = " ".join([path.resolve().parent.name, *splits])
        if name in sets:
            raise InputError(f"two sets are called {name!r}; rename a folder")
        sets[name] = path, splits[0] if splits else None
    return sets
