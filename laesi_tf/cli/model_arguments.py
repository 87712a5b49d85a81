"""The options that name the models a command measures with."""

import argparse
import sys
from pathlib import Path
from typing import Any

from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.run_files import needs_tensorflow, require_run
from laesi_tf.common.tensorflow import require_tensorflow


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


def load_tensorflow_if_needed(options: argparse.Namespace) -> None:
    """Import TensorFlow if a model is a training run, which Keras runs; the shipped and exported ones need
    none.

    Raises InputError where it is not installed.
    """
    models = (options.model, options.mask_model, options.ruling_model)
    runs = [model for model in models if model is not None and needs_tensorflow(model)]
    if not runs:
        return
    require_run(runs[0])
    require_tensorflow(f"the training run {runs[0]}")
    if sys.stderr is not None and sys.stderr.isatty():
        print("loading TensorFlow; the first photo takes some seconds longer", file=sys.stderr)
    load_tensorflow(is_reproducible=True)
