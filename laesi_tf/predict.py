"""Measure the leaves on photos: cm2 per photo, a CSV, and an overlay that shows what was found on each."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from laesi_tf.cli import add_models, parser, progress, run
from laesi_tf.data.ahead import read_ahead
from laesi_tf.data.decoding import SUFFIXES, decode
from laesi_tf.errors import InputError
from laesi_tf.estimators import Estimator, Known, Leaf, Measurement, load_estimator
from laesi_tf.files import require_writable, write_csv, write_json
from laesi_tf.overlay import FOUND, SIDE, captioned, gridded, outlined, printable, write_png

_OVERLAY = ".overlay.png"
_COLUMNS = ("photo", "area_cm2", "px_per_mm", "method", "error")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One leaf, or one photo on which none was measured."""

    photo: str
    area_cm2: float | None = None
    px_per_mm: float | None = None
    method: str | None = None
    error: str | None = None
    """Why there is no area: the file is bad or the estimator refused."""
    overlay: str | None = None
    """Name of the overlay's file."""


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError, also when not a single photo can be read."""
    options = _parser().parse_args(arguments)
    estimator = load_estimator(options.model, mask_run=options.mask_model)
    photos = list(dict.fromkeys(_photos(options.photos)))
    table = options.out / "areas.csv"
    for path in (table, options.json):
        if path is not None:
            require_writable(path)
    rows = predict(
        estimator, photos, known=Known(px_per_mm=options.px_per_mm, grid_mm=options.grid_mm), out=options.out
    )
    write_csv(table, [*_COLUMNS, "overlay"], ([*_record(row).values(), row.overlay] for row in rows))
    if options.json is not None:
        write_json(options.json, [_record(row) for row in rows])
    _report(rows, table)


def predict(estimator: Estimator, photos: Sequence[Path], *, known: Known, out: Path) -> list[Row]:
    """Measure `photos` and write an overlay of each into `out`; bad files become rows with an error.

    Raises InputError when no file is good; nothing is written then.
    """
    rows: list[Row] = []
    names = _overlay_names(photos)
    decoded = progress(read_ahead(decode, photos), total=len(photos), desc="measuring", unit="photo")
    for photo, image in decoded:
        if isinstance(image, InputError):
            rows.append(Row(photo=str(photo), error=str(image)))
            continue
        measurement = estimator.measure(image, known)
        write_png(out / names[photo], _picture(image, measurement, photo.name))
        rows += _rows(str(photo), measurement, names[photo])
    if all(row.overlay is None for row in rows):
        more = "" if len(photos) == 1 else f" (and none of the other {len(photos) - 1} photos can be read)"
        raise InputError(f"{rows[0].error}{more}")
    return rows


def _parser() -> argparse.ArgumentParser:
    made = parser("predict", __doc__)
    made.add_argument("photos", nargs="+", type=Path, metavar="PHOTO", help="a photo, or a folder of photos")
    add_models(made)
    made.add_argument(
        "--px-per-mm",
        type=_scale,
        metavar="N",
        help="scale of all photos in pixels per mm, for a mask model alone",
    )
    made.add_argument(
        "--grid-mm", type=_scale, default=1.0, metavar="MM", help="distance of the paper's finest lines"
    )
    made.add_argument(
        "--out",
        type=Path,
        default=Path("predictions"),
        metavar="DIR",
        help="folder for areas.csv and overlays",
    )
    return made


def _scale(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def _photos(arguments: Sequence[Path]) -> Iterator[Path]:
    """Yield the photos that `arguments` name; of a folder the pictures in it, not in folders below it."""
    for argument in arguments:
        if not argument.is_dir():
            yield argument
            continue
        inside = sorted(path for path in _listed(argument) if path.suffix.lower() in SUFFIXES)
        photos = [path for path in inside if not path.name.endswith(_OVERLAY)]
        if not photos:
            raise InputError(f"folder {argument} has no photo in it; name one with JPEG, PNG or TIFF files")
        yield from photos


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise InputError(f"cannot list {folder}: {error.strerror}; check its permissions") from None


def _overlay_names(photos: Sequence[Path]) -> dict[Path, str]:
    """A file name for each photo; like-named photos from several folders are numbered, case ignored."""
    taken: set[str] = set()
    names: dict[Path, str] = {}
    for photo in photos:
        stem = photo.stem[:50]  # 255 bytes are a name's limit, and a letter takes up to four.
        name, number = stem + _OVERLAY, 1
        while name.lower() in taken:
            number += 1
            name = f"{stem}-{number}{_OVERLAY}"
        taken.add(name.lower())
        names[photo] = name
    return names


def _rows(photo: str, measurement: Measurement, overlay: str) -> list[Row]:
    if measurement.refusal is not None:
        return [Row(photo=photo, method=measurement.method, error=measurement.refusal, overlay=overlay)]
    return [
        Row(
            photo=photo,
            area_cm2=leaf.area_cm2,
            px_per_mm=leaf.px_per_mm,
            method=measurement.method,
            overlay=overlay,
        )
        for leaf in measurement.leaves
    ]


def _picture(image: np.ndarray, measurement: Measurement, name: str) -> np.ndarray:
    outlines = [(leaf.outline, FOUND) for leaf in measurement.leaves if leaf.outline is not None]
    areas = [_area(leaf) for leaf in measurement.leaves if leaf.area_cm2 is not None]
    said = ", ".join(areas) if measurement.refusal is None else f"refused: {measurement.refusal}"
    # A small photo is enlarged until the text beneath it can be read.
    side = min(SIDE, max(SIDE // 2, *image.shape[:2]))
    if measurement.to_mm is not None:
        image = gridded(image, measurement.to_mm)
    return captioned(
        outlined(image, outlines, side=side), [said, f"{printable(name)}  ({measurement.method})"]
    )


def _area(leaf: Leaf) -> str:
    uncertainty = "" if leaf.uncertainty_cm2 is None else f" ± {leaf.uncertainty_cm2:.2f}"
    scale = "" if leaf.px_per_mm is None else f" at {leaf.px_per_mm:.2f} px/mm"
    return f"{leaf.area_cm2:.2f}{uncertainty} cm²{scale}"


def _record(row: Row) -> dict[str, object]:
    return {column: getattr(row, column) for column in _COLUMNS}


def _report(rows: Sequence[Row], table: Path) -> None:
    """Print a line for each leaf or failure, and the totals."""
    width = max(len(printable(row.photo)) for row in rows)
    for row in rows:
        said = printable(row.error) if row.area_cm2 is None else f"{row.area_cm2:9.2f} cm2"
        print(f"{printable(row.photo):<{width}}  {said}")
    skipped = sum(row.overlay is None for row in rows)
    refused = sum(row.error is not None and row.overlay is not None for row in rows)
    measured = sum(row.area_cm2 is not None for row in rows)
    print(
        f"leaves measured: {measured}, photos refused: {refused}, skipped: {skipped}; see {printable(table)}"
    )


if __name__ == "__main__":
    run(main)
