"""Options that commands on data sets share."""

import argparse
from pathlib import Path

from laesi_tf.common.parsing import positive_float, shard_fraction


def add_shard_argument(parser: argparse.ArgumentParser, *, verb: str) -> None:
    """Add --shard, for a command that does what `verb` says to every image."""
    parser.add_argument(
        "--shard",
        type=shard_fraction,
        default=(0, 1),
        metavar="I/N",
        help=f"{verb} part I of N only, counted from 0 (default: 0/1, all)",
    )


def add_filter_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --mask-run and --max-deviation, of the consistency filter."""
    parser.add_argument(
        "--mask-run",
        type=Path,
        metavar="RUN",
        help="training run of task mask (default: the one that comes with the package)",
    )
    parser.add_argument(
        "--max-deviation",
        type=_max_deviation,
        default=0.15,
        metavar="SHARE",
        help="largest number of wrong pixels that is accepted, relative to those of the leaf",
    )


def _max_deviation(text: str) -> float:
    return positive_float(text, what="share of the leaf")


def add_ranges_argument(parser: argparse.ArgumentParser) -> None:
    """Add the ranges of scenes, by default those of `rendering_2`."""
    parser.add_argument(
        "--ranges", default="rendering_2", metavar="PRESET|FILE", help="ranges that scenes are sampled from"
    )
