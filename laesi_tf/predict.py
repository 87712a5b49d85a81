"""Measure the leaves on photos: cm2 per leaf, a CSV, and an overlay that shows what was found on each photo.

Leaves are numbered in reading order, in the table as in the overlay. The area is flat and one-sided, holes
subtracted, petiole included; the uncertainty is one standard deviation.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.model_arguments import add_model_arguments
from laesi_tf.common.atomic_files import require_writable, write_csv, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_float
from laesi_tf.common.progress import progress_bar
from laesi_tf.common.text import sanitise_text
from laesi_tf.data.decoding import PHOTO_SUFFIXES, decode_photo
from laesi_tf.data.prefetch import prefetch
from laesi_tf.estimators.base import Estimator, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.reporting.captions import add_caption, draw_labels
from laesi_tf.reporting.overlay import OVERLAY_SIDE_PX, PREDICTED_COLOUR, draw_grid, draw_outlines, write_png

_OVERLAY = ".overlay.png"
_FIGURES = ("area_cm2", "uncertainty_cm2", "px_per_mm", "length_mm", "width_mm", "perimeter_mm", "holes_cm2")
_COLUMNS = ("photo", "leaf", *_FIGURES, "tilt_deg", "method", "refused", "note", "error")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One leaf, or one photo on which none was measured; the figures are those of `Leaf`."""

    photo: str
    leaf: int | None = None
    """Number of the leaf on its photo, from 1 in reading order."""
    area_cm2: float | None = None
    uncertainty_cm2: float | None = None
    px_per_mm: float | None = None
    length_mm: float | None = None
    width_mm: float | None = None
    perimeter_mm: float | None = None
    holes_cm2: float | None = None
    tilt_deg: float | None = None
    method: str | None = None
    refused: bool = False
    """Whether the photo was read but the estimator would not measure it."""
    note: str | None = None
    """What to know before believing the area."""
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
        estimator,
        photos,
        known=PhotoInfo(px_per_mm=options.px_per_mm, grid_mm=options.grid_mm),
        out=options.out,
    )
    write_csv(table, [*_COLUMNS, "overlay"], ([*_record(row).values(), row.overlay] for row in rows))
    if options.json is not None:
        write_json(options.json, [_record(row) for row in rows])
    _report(rows, table)


def predict(estimator: Estimator, photos: Sequence[Path], *, known: PhotoInfo, out: Path) -> list[Row]:
    """Measure `photos` and write an overlay of each into `out`; bad files become rows with an error.

    Raises InputError when no file is good; nothing is written then.
    """
    rows: list[Row] = []
    names = _overlay_names(photos)
    decoded = progress_bar(prefetch(decode_photo, photos), total=len(photos), desc="measuring", unit="photo")
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
    made = make_parser("predict", __doc__)
    made.add_argument("photos", nargs="+", type=Path, metavar="PHOTO", help="a photo, or a folder of photos")
    add_model_arguments(made)
    made.add_argument(
        "--px-per-mm",
        type=positive_float,
        metavar="N",
        help="scale of all photos in pixels per mm, for rule_based or a mask model alone",
    )
    made.add_argument(
        "--grid-mm",
        type=positive_float,
        default=1.0,
        metavar="MM",
        help="distance of the paper's finest lines",
    )
    made.add_argument(
        "--out",
        type=Path,
        default=Path("predictions"),
        metavar="DIR",
        help="folder for areas.csv and overlays",
    )
    return made


def _photos(arguments: Sequence[Path]) -> Iterator[Path]:
    """Yield the photos that `arguments` name; of a folder the pictures in it, not in folders below it."""
    for argument in arguments:
        if not argument.is_dir():
            yield argument
            continue
        inside = sorted(path for path in _listed(argument) if path.suffix.lower() in PHOTO_SUFFIXES)
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
        error = measurement.refusal
        return [Row(photo=photo, method=measurement.method, overlay=overlay, refused=True, error=error)]
    return [
        Row(
            photo=photo,
            method=measurement.method,
            overlay=overlay,
            leaf=number,
            tilt_deg=measurement.tilt_deg,
            note="; ".join(filter(None, [leaf.note, measurement.note])) or None,
            **{name: getattr(leaf, name) for name in _FIGURES},
        )
        for number, leaf in enumerate(measurement.leaves, 1)
    ]


def _picture(image: np.ndarray, measurement: Measurement, name: str) -> np.ndarray:
    """The photo with lattice and numbered outlines on it and the figures below."""
    # A small photo is enlarged until the text beneath it can be read.
    side = min(OVERLAY_SIDE_PX, max(OVERLAY_SIDE_PX // 2, *image.shape[:2]))
    scale = side / max(image.shape[:2])
    picture = draw_outlines(image, [], side=side)
    if measurement.to_mm is not None:
        picture = draw_grid(picture, measurement.to_mm @ np.diag([1 / scale, 1 / scale, 1.0]))
    rings = [ring for leaf in measurement.leaves for ring in (leaf.outline, *leaf.holes) if ring is not None]
    picture = draw_outlines(
        picture, [((ring + 0.5) * scale - 0.5, PREDICTED_COLOUR) for ring in rings], side=side
    )
    if len(measurement.leaves) > 1:
        picture = draw_labels(picture, _labels(measurement, scale))
    return add_caption(picture, [*_said(measurement), f"{sanitise_text(name)}  ({measurement.method})"])


def _labels(measurement: Measurement, scale: float) -> list[tuple[np.ndarray, str]]:
    """Number and area of each leaf, at the middle of its box in the overlay."""
    labels = []
    for number, leaf in enumerate(measurement.leaves, 1):
        if leaf.outline is not None:
            text = str(number) if leaf.area_cm2 is None else f"{number}: {leaf.area_cm2:.2f}"
            labels.append(((leaf.outline.min(axis=0) + leaf.outline.max(axis=0)) / 2 * scale, text))
    return labels


def _said(measurement: Measurement) -> list[str]:
    """The overlay's text on what was measured and whether to believe it."""
    if measurement.refusal is not None:
        return [f"refused: {measurement.refusal}"]
    leaves = measurement.leaves
    said = [_total(leaves)]
    if scales := [leaf.px_per_mm for leaf in leaves if leaf.px_per_mm is not None]:
        said.append(f"{np.mean(scales):.2f} px/mm")
    if measurement.tilt_deg is not None:
        said.append(f"tilt {measurement.tilt_deg:.0f}°")
    if len(leaves) == 1 and leaves[0].length_mm is not None and leaves[0].width_mm is not None:
        said.append(f"{leaves[0].length_mm:.1f} × {leaves[0].width_mm:.1f} mm")
    notes = [measurement.note] if measurement.note else []
    notes += [
        f"leaf {number}: {leaf.note}" if len(leaves) > 1 else leaf.note
        for number, leaf in enumerate(leaves, 1)
        if leaf.note
    ]
    return [", ".join(said), *notes[:3]]


def _total(leaves: Sequence[LeafMeasurement]) -> str:
    """The area of all leaves together; what is wrong with one scale is wrong with all, so doubts add up."""
    total = sum(leaf.area_cm2 or 0.0 for leaf in leaves)
    doubt = sum(leaf.uncertainty_cm2 or math.nan for leaf in leaves)
    said = f"{total:.2f} cm²" if math.isnan(doubt) else f"{total:.2f} ± {doubt:.2f} cm²"
    return said if len(leaves) == 1 else f"{len(leaves)} leaves, {said}"


def _record(row: Row) -> dict[str, object]:
    return {column: getattr(row, column) for column in _COLUMNS}


def _report(rows: Sequence[Row], table: Path) -> None:
    """Print a line for each photo, below it one for each leaf where it has several, and the totals."""
    photos: dict[str, list[Row]] = {}
    for row in rows:
        photos.setdefault(row.photo, []).append(row)
    width = max(len(sanitise_text(photo)) for photo in photos)
    for photo, leaves in photos.items():
        print(f"{sanitise_text(photo):<{width}}  {_line(leaves)}")
        if len(leaves) > 1:
            for row in leaves:
                print(f"{f'leaf {row.leaf}':>{width}}  {_line([row])}")
    skipped = sum(row.overlay is None for row in rows)
    refused = sum(row.refused for row in rows)
    measured = sum(row.area_cm2 is not None for row in rows)
    print(
        f"leaves measured: {measured}, photos refused: {refused}, skipped: {skipped}; see {sanitise_text(table)}"
    )


def _line(rows: Sequence[Row]) -> str:
    """The area of `rows` together, or why there is none."""
    if rows[0].area_cm2 is None:
        return sanitise_text(rows[0].error)
    said = f"{sum(row.area_cm2 or 0.0 for row in rows):9.2f} cm2"
    doubt = sum(row.uncertainty_cm2 or math.nan for row in rows)
    said += "" if math.isnan(doubt) else f" ± {doubt:.2f}"
    if len(rows) > 1:
        return f"{said}, {len(rows)} leaves"
    return said if rows[0].note is None else f"{said}  ({rows[0].note})"


if __name__ == "__main__":
    run_command(main)
