"""Command line options of a budget."""

import argparse
import dataclasses
from collections.abc import Callable
from typing import Any

from laesi_tf.common.parsing import positive_int
from sweeps.trials.budget import FINAL, SCREENING, Budget

_PARSERS: dict[type, tuple[Callable[[str], Any], str]] = {
    int: (positive_int, "N"),
    float: (float, "FACTOR"),
    str: (str, "NAME|FILE"),
}


def add_budget_arguments(made: argparse.ArgumentParser) -> None:
    """Add an option for each field of Budget; one that is not given is None."""
    for field in dataclasses.fields(Budget):
        low, high = (getattr(preset, field.name) for preset in (SCREENING, FINAL))
        default = f"{low}, for what is tried again {high}" if low != high else f"{low}"
        made.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=_PARSERS[type(low)][0],
            metavar=_PARSERS[type(low)][1],
            help=f"{field.metadata['help']} (default: {default})",
        )


def budget_from_args(options: argparse.Namespace, preset: Budget) -> Budget:
    """`preset` with what was given."""
    names = [field.name for field in dataclasses.fields(Budget)]
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    return dataclasses.replace(preset, **given)
