"""Measure the leaves on photos: cm2 per leaf, a CSV, and an overlay that shows what was found on each photo.

Leaves are numbered in reading order, in the table as in the overlay. The area is flat and one-sided, holes
subtracted, petiole included; the uncertainty is one standard deviation.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.model_arguments import add_model_arguments, model_options
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_float
from laesi_tf.common.progress import progress_bar
from laesi_tf.common.text import sanitise_text
from laesi_tf.data.decoding import decode_photo, require_path
from laesi_tf.data.file_formats import PHOTO_SUFFIXES
from laesi_tf.data.photo_pages import PhotoPage, list_pages
from laesi_tf.data.prefetch import prefetch
from laesi_tf.estimators.base import Estimator, PhotoInfo, sum_uncertainties
from laesi_tf.reporting.leaf_records import LeafRecord, make_records, write_records

_OVERLAY = ".overlay.png"


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError, also when not a single photo can be read."""
    options = _make_parser().parse_args(arguments)
    photos = list(dict.fromkeys(_list_photos([require_path(text) for text in options.photos])))
    table = options.out / "areas.csv"
    require_writable(table)
    load_tensorflow()
    from laesi_tf.estimators import factory
    from laesi_tf.models.saved_model import PRETRAINED

    models = model_options(options)
    if options.px_per_mm is not None and options.model is None:
        # A given scale needs no ruling.
        models = {"run": options.mask_model or PRETRAINED / "mask"}
    models["reads_ruling"] = options.px_per_mm is None
    estimator = factory.load_estimator(**models)
    info = PhotoInfo(px_per_mm=options.px_per_mm, grid_mm=options.grid_mm)
    records: list[LeafRecord] = []
    try:
        for new in measure_photos(estimator, photos, info=info, out=options.out):
            records += new
    finally:
        # Also after Ctrl-C or on a full disk: what was measured is kept.
        if any(record.overlay is not None for record in records):
            write_records(records, table=table, json=options.json)
    if all(record.overlay is None for record in records):
        more = "" if len(photos) == 1 else f" (and none of the other {len(photos) - 1} photos can be read)"
        raise InputError(f"{records[0].error}{more}")
    _print_summary(records, table)


def measure_photos(
    estimator: Estimator, photos: Sequence[Path], *, info: PhotoInfo, out: Path
) -> Iterator[list[LeafRecord]]:
    """Measure `photos`, write an overlay of each into the folder `out` and yield its records.

    Each page of a TIFF is a photo. A photo that cannot be read becomes a record with an error. Raises
    InputError where `out` cannot be written.
    """
    from laesi_tf.reporting.measurement_overlay import draw_measurement
    from laesi_tf.reporting.overlay import write_png

    pages = [page for photo in photos for page in list_pages(photo)]
    names = _name_overlays(pages)
    loaded = prefetch(lambda page: decode_photo(page.path, page=page.index), pages)
    for photo, image in progress_bar(loaded, total=len(pages), desc="measuring", unit="photo"):
        if isinstance(image, InputError):
            yield [LeafRecord(photo=str(photo), error=str(image))]
            continue
        measurement = estimator.measure(image, info)
        write_png(out / names[photo], draw_measurement(image, measurement, photo.name))
        yield make_records(str(photo), measurement, names[photo])


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("predict", __doc__)
    parser.add_argument("photos", nargs="+", metavar="PHOTO", help="a photo, or a folder of photos")
    add_model_arguments(parser)
    parser.add_argument(
        "--px-per-mm",
        type=positive_float,
        metavar="N",
        help="scale of all photos in pixels per mm, such as a scanner's: no ruling is read",
    )
    parser.add_argument(
        "--grid-mm",
        type=positive_float,
        metavar="MM",
        help="distance between the finest lines of the paper (default: millimetres, if heavier lines say so)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("predictions"),
        metavar="DIR",
        help="folder for areas.csv and overlays",
    )
    return parser


def _list_photos(arguments: Sequence[Path]) -> Iterator[Path]:
    """Yield the photos that `arguments` name: of a folder the photos in it, without subfolders."""
    for argument in arguments:
        if not argument.is_dir():
            yield argument
            continue
        try:
            files = sorted(path for path in argument.iterdir() if path.suffix.lower() in PHOTO_SUFFIXES)
        except OSError as error:
            raise InputError(f"cannot list {argument}: {error.strerror}; check its permissions") from None
        photos = [path for path in files if not path.name.endswith(_OVERLAY)]
        if not photos:
            raise InputError(f"folder {argument} has no photo in it; name one with JPEG, HEIC or TIFF files")
        yield from photos


def _name_overlays(photos: Sequence[PhotoPage]) -> dict[PhotoPage, str]:
    """Return a file name for each photo's overlay; photos of the same name, case ignored, are numbered."""
    taken: set[str] = set()
    names: dict[PhotoPage, str] = {}
    for photo in photos:
        stem = photo.path.stem[:50]  # A name has at most 255 bytes, a letter up to four.
        if photo.number is not None:
            stem += f"-page{photo.number}"
        name, number = stem + _OVERLAY, 1
        while name.lower() in taken:
            number += 1
            name = f"{stem}-{number}{_OVERLAY}"
        taken.add(name.lower())
        names[photo] = name
    return names


def _print_summary(records: Sequence[LeafRecord], table: Path) -> None:
    """Print a line for each photo, a line for each leaf where it has several, and the totals."""
    photos: dict[str, list[LeafRecord]] = {}
    for record in records:
        photos.setdefault(record.photo, []).append(record)
    width = max(len(sanitise_text(photo)) for photo in photos)
    for photo, leaves in photos.items():
        print(f"{sanitise_text(photo):<{width}}  {_format_records(leaves)}")
        if len(leaves) > 1:
            for record in leaves:
                print(f"{f'leaf {record.leaf}':>{width}}  {_format_records([record])}")
    skipped = sum(record.overlay is None for record in records)
    refused = sum(record.refused for record in records)
    measured = sum(record.area_cm2 is not None for record in records)
    print(
        f"leaves measured: {measured}, photos refused: {refused}, skipped: {skipped}; "
        f"see {sanitise_text(table)}"
    )


def _format_records(records: Sequence[LeafRecord]) -> str:
    """Return the total area of `records` as text, or why there is none."""
    if records[0].area_cm2 is None:
        return sanitise_text(records[0].error)
    text = f"{sum(record.area_cm2 or 0.0 for record in records):9.2f} cm2"
    uncertainty = sum_uncertainties([record.uncertainty_cm2 for record in records])
    text += "" if uncertainty is None else f" ± {uncertainty:.2f}"
    if len(records) > 1:
        return f"{text}, {len(records)} leaves"
    return text if records[0].note is None else f"{text}  ({records[0].note})"


if __name__ == "__main__":
    run_command(main)
