"""The options that name the models a command measures with."""

import argparse
from pathlib import Path


def add_model_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that name the models a command measures with."""
    parser.add_argument(
        "--model",
        type=Path,
        metavar="RUN|rule_based",
        help="training run that measures, or Easy Leaf Area's rules, which need a red square of 4 cm2 in the "
        "photo (default: the runs that come with the package)",
    )
    parser.add_argument(
        "--mask-model", type=Path, metavar="RUN", help="training run of task mask: the ruling is read too"
    )
