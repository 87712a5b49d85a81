"""The options that name the models a command measures with."""

import argparse
from pathlib import Path
from typing import Any


def add_model_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that name the models a command measures with."""
    parser.add_argument(
        "--model",
        type=Path,
        metavar="RUN|FILE.tflite|NAME",
        help="training run that measures alone, a LiteRT file that export wrote, rule_based (Easy Leaf "
        "Area's rules, which need a red square of 4 cm2 in the photo) or excess_green (a colour threshold, "
        "which needs a given scale) (default: the mask and the ruling model that come with the package)",
    )
    parser.add_argument(
        "--mask-model",
        type=Path,
        metavar="RUN",
        help="training run of task mask, which finds the leaves (default: the one that comes with the "
        "package)",
    )
    parser.add_argument(
        "--ruling-model",
        type=Path,
        metavar="RUN",
        help="training run of task ruling, which finds the lines (default: the one that comes with the "
        "package)",
    )
    parser.add_argument(
        "--guess",
        action="store_true",
        help="where no ruling can be read, let an area model guess instead of refusing the photo: the one "
        "that comes with the package, unless --model names another",
    )


def model_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of `laesi_tf.estimators.factory.load_estimator`."""
    return {
        "run": options.model,
        "mask_run": options.mask_model,
        "ruling_run": options.ruling_model,
        "guess": options.guess,
    }
