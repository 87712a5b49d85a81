"""Export networks for use elsewhere: LiteRT files for phones, or runs with float16 weights.

`--format litert` writes the whole measurement, photo in and cm2 out, and the area and mask networks alone, in
several precisions. Every file is opened again and measured on the same pictures as the estimator that it
comes from; one that is over 0.5 points worse is not kept, and the exit status is 1. `--format keras` writes
one run with float16 weights. `--format package` writes three, with their networks for LiteRT beside the
weights: measuring with them needs no TensorFlow. Their areas are compared, with the same exit status.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow, suppress_stderr
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int
from laesi_tf.common.run_files import CONFIG_FILE, EXPORTED_WEIGHTS_FILE, PRETRAINED
from laesi_tf.data.manifest import read_manifest

if TYPE_CHECKING:
    from laesi_tf.exporting.app_folder import Networks

_PRECISIONS = ("float32", "float16", "dynamic", "int8")
_DEFAULT_PRECISIONS = ("float32", "float16")
_DEFAULT_SCENES = 16
_FORMATS = {
    "precision": ("litert",),
    "scenes": ("litert", "package"),
    "photos": ("litert", "package"),
    "split": ("litert", "package"),
}
"""The formats that an option has an effect on; all others have one on every format."""
_CALIBRATION_SCENES = 32


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for a run that is missing or a folder that cannot be written."""
    options = _make_parser().parse_args(arguments)
    _check_options(options)
    if options.format == "keras":
        _export_keras(options)
    elif options.format == "package":
        _export_package(options)
    else:
        _export_litert(options)


def _check_options(options: argparse.Namespace) -> None:
    """Raise InputError for an option that would have no effect beside the others."""
    for name, formats in _FORMATS.items():
        if getattr(options, name) is not None and options.format not in formats:
            raise InputError(
                f"--{name} has no effect with --format {options.format}; leave it out, or add --format "
                f"{' or '.join(formats)}"
            )
    if options.split is not None and options.photos is None:
        raise InputError("--split has no effect without --photos; name the manifest, or leave it out")
    if options.scenes is not None and options.photos is not None:
        raise InputError(
            "--scenes has no effect with --photos, which are measured instead; leave out one of them"
        )
    is_int8_alone = options.precision is not None and set(options.precision) == {"int8"}
    if options.ruling_run is not None and is_int8_alone:
        raise InputError(
            "--ruling-run has no effect with --precision int8, which only the area and the mask network "
            "have; add another precision, or leave it out"
        )


def _export_keras(options: argparse.Namespace) -> None:
    """Write one run with float16 weights and compare it with the original on fresh scenes."""
    runs = [run for run in (options.run, options.mask_run, options.ruling_run) if run is not None]
    if len(runs) != 1:
        raise InputError(
            "--format keras exports one run; name it with --run (the shipped ones have this format already)"
        )
    require_writable(options.out / CONFIG_FILE)
    load_tensorflow()
    from laesi_tf.exporting.float16 import compute_test_metrics, export_float16
    from laesi_tf.models.saved_model import load_run

    original = load_run(runs[0])
    export_float16(original, options.out)
    metrics = {
        "original": compute_test_metrics(original),
        "exported": compute_test_metrics(load_run(options.out)),
    }
    size = (options.out / EXPORTED_WEIGHTS_FILE).stat().st_size
    for name, values in metrics.items():
        print(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in values.items()))
    print(f"exported: {options.out}, weights {size / 1e6:.1f} MB")
    if options.json is not None:
        write_json(options.json, {**metrics, "bytes": size})


def _export_litert(options: argparse.Namespace) -> None:
    """Write LiteRT files, a golden photo and a page for app makers, and print the table of scores."""
    photos = None if options.photos is None else read_manifest(options.photos, split=options.split)
    require_writable(options.out / "README.md")
    load_tensorflow()
    from laesi_tf.exporting.app_folder import export_litert, write_guide
    from laesi_tf.exporting.litert_check import (
        HEADER,
        load_pictures,
        render_calibration,
        render_pictures,
        to_json,
    )

    networks = _load_networks(options)
    precisions = options.precision or _DEFAULT_PRECISIONS
    options.out.mkdir(parents=True, exist_ok=True)
    # The first is the golden photo, also where the files are measured on others.
    scenes = render_pictures((options.scenes or _DEFAULT_SCENES) if photos is None else 1)
    pictures = scenes if photos is None else load_pictures(photos)
    calibration = render_calibration(_CALIBRATION_SCENES) if "int8" in precisions else []
    scores = []
    print(f"{len(pictures)} pictures; a file may be 0.5 points worse than its parent, in Keras")
    print(HEADER)
    # The converter writes hundreds of lines to stderr.
    with suppress_stderr():
        for score in export_litert(
            networks, options.out, pictures, calibration=calibration, variants=precisions
        ):
            scores.append(score)
            print(score.as_row(), flush=True)
        write_guide(options.out, scenes[0])
    if options.json is not None:
        write_json(options.json, {"files": to_json(scores), "pictures": len(pictures)})
    print(f"written: {options.out}")
    if not all(score.is_kept for score in scores):
        raise SystemExit(1)


def _export_package(options: argparse.Namespace) -> None:
    """Write exported runs with their networks for LiteRT, and print how their areas differ."""
    photos = None if options.photos is None else read_manifest(options.photos, split=options.split)
    require_writable(options.out / "area" / CONFIG_FILE)
    load_tensorflow(is_reproducible=True)
    from laesi_tf.exporting.litert_check import HEADER, load_pictures, render_pictures, to_json
    from laesi_tf.exporting.package import check_package, export_package

    print("converting the reader of rulings takes two minutes", flush=True)
    with suppress_stderr():
        export_package(_load_networks(options), options.out)
    pictures = render_pictures(options.scenes or _DEFAULT_SCENES) if photos is None else load_pictures(photos)
    print(f"{len(pictures)} pictures")
    print(HEADER)
    scores = []
    for score in check_package(options.out, pictures):
        scores.append(score)
        print(score.as_row(), flush=True)
    if options.json is not None:
        write_json(options.json, {"files": to_json(scores), "pictures": len(pictures)})
    print(f"written: {options.out}")
    if not all(score.is_kept for score in scores):
        raise SystemExit(1)


def _load_networks(options: argparse.Namespace) -> "Networks":
    """Load the runs that the options name, or the shipped ones. Raises InputError."""
    from laesi_tf.estimators.keras_networks import load_run_of
    from laesi_tf.exporting.app_folder import Networks

    return Networks(
        area=load_run_of("area", options.run or PRETRAINED / "area"),
        mask=load_run_of("mask", options.mask_run or PRETRAINED / "mask"),
        ruling=load_run_of("ruling", options.ruling_run or PRETRAINED / "ruling"),
    )


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("export", __doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    parser.add_argument(
        "--format",
        choices=("litert", "keras", "package"),
        default="litert",
        help="what to write: files for phones, a run, or runs as the package ships them",
    )
    for option, what in (
        ("--run", "area; with --format keras, of any task"),
        ("--mask-run", "mask"),
        ("--ruling-run", "ruling"),
    ):
        parser.add_argument(
            option, type=Path, metavar="RUN", help=f"run of task {what} (default: the shipped one)"
        )
    parser.add_argument(
        "--precision",
        nargs="+",
        choices=_PRECISIONS,
        help="precisions of the LiteRT files; int8 does not hold for the shipped networks "
        f"(default: {' '.join(_DEFAULT_PRECISIONS)})",
    )
    parser.add_argument(
        "--scenes",
        type=positive_int,
        metavar="N",
        help=f"rendered scenes that files are measured on (default: {_DEFAULT_SCENES})",
    )
    parser.add_argument(
        "--photos",
        type=Path,
        metavar="CSV",
        help="measure on the photos of a manifest instead: image,area_cm2,...",
    )
    parser.add_argument("--split", help="only this split of the manifest")
    return parser


if __name__ == "__main__":
    run_command(main)
