"""How long a photo takes to be measured."""

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.model_arguments import add_model_arguments
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.parsing import image_size, positive_int
from laesi_tf.common.progress import progress_bar
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.factory import load_estimator

# isort: split
import cv2
from PIL import Image

from laesi_tf.benchmarks.timing import MedianIqr, format_row
from laesi_tf.data.decoding import decode_photo
from laesi_tf.synthesis import synthesise

Size = tuple[int, int]

_SCENE_PX, _PASSES = 1600, 4
"""Longer side at which the scene of a photo is made; pictures of the same leaf."""


def main(arguments: Sequence[str]) -> None:
    """Time to measure a photo, decoded and from its JPEG file, with the models named or those shipped."""
    options = _make_parser().parse_args(arguments)
    if options.json is not None:
        require_writable(options.json)
    estimator = load_estimator(options.model, mask_run=options.mask_model)
    figures = time_photos(estimator, seed=options.seed, size=options.size, repeats=options.repeats)
    figures |= describe_hardware()
    if options.json is not None:
        write_json(options.json, figures)
    print(_format_table(figures))


def time_photos(estimator: Estimator, *, seed: int, size: Size, repeats: int) -> dict[str, Any]:
    """Milliseconds to decode a photo of `size` and to measure it, medians over scenes, and their ranges.

    A scene is made at `_SCENE_PX` and enlarged: as in a phone's photo, single pixels hold nothing new.
    """
    decoding, measuring, methods = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "photo.jpg"
        for index in progress_bar(range(repeats + 1), desc="photos", unit="photo"):
            scene = synthesise(seed, size=_scene_size(size), index=index * _PASSES)["image"].numpy()
            enlarged = cv2.resize(scene, size[::-1], interpolation=cv2.INTER_CUBIC)
            Image.fromarray(enlarged).save(path, quality=90)
            begun = time.perf_counter()
            image = decode_photo(path)
            decoded = time.perf_counter()
            measurement = estimator.measure(image)
            decoding.append((decoded - begun) * 1e3)
            measuring.append((time.perf_counter() - decoded) * 1e3)
            methods.append(measurement.method)
    # The first photo traces graphs.
    spreads = {"decode": MedianIqr.of(decoding[1:]), "measure": MedianIqr.of(measuring[1:])}
    return {
        "megapixels": size[0] * size[1] / 1e6,
        "photos": repeats,
        "methods": sorted(set(methods[1:])),
        **{f"{name}_ms": spread.median for name, spread in spreads.items()},
        **{f"{name}_ms_iqr": spread.iqr for name, spread in spreads.items()},
    }


def _scene_size(size: Size) -> Size:
    """`size` with its longer side brought to `_SCENE_PX`, or as it is where that is less."""
    scale = min(1.0, _SCENE_PX / max(size))
    return round(size[0] * scale), round(size[1] * scale)


def _format_table(figures: dict[str, Any]) -> str:
    rows = [
        format_row(f"{name}, {figures['megapixels']:.1f} megapixels, ms", f"{median:.0f}", f"{iqr:.0f}")
        for name in ("decode", "measure")
        for median, iqr in [(figures[f"{name}_ms"], figures[f"{name}_ms_iqr"])]
    ]
    machine = "{photos} photos, {machine}, {cores} cores, TensorFlow {tensorflow}, {date}".format_map(figures)
    return "\n".join(
        [format_row("", "median", "IQR"), *rows, f"measured by {', '.join(figures['methods'])}", machine]
    )


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("benchmark photo", main.__doc__)
    add_model_arguments(made)
    made.add_argument("--seed", type=int, default=0, help="seed of the scenes that are photographed")
    made.add_argument(
        "--size", type=image_size, default=(3000, 4000), metavar="PX", help="SIDE or HEIGHTxWIDTH"
    )
    made.add_argument("--repeats", type=positive_int, default=20, metavar="N", help="photos")
    return made
