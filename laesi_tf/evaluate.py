"""Score an estimator on real photos of known leaf area, per subset of the manifest.

MRE, median and p90 are relative errors of the area in percent, over the photos that were not refused; mIoU
(the leaf's intersection over union) and MPE (relative error of the count of leaf pixels) are fractions, over
the photos that have a mask. n counts the photos that could be read.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.model_arguments import add_model_arguments
from laesi_tf.common.atomic_files import require_writable, write_csv, write_json
from laesi_tf.common.geometry import trace_largest_contour
from laesi_tf.common.text import sanitise_text
from laesi_tf.data.manifest import read_manifest
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.evaluation.photo_scores import (
    PhotoScore,
    group_by_subset,
    load_photo_and_mask,
    photo_info,
    score_photos,
    sort_worst_first,
    summarise,
)
from laesi_tf.reporting.captions import add_caption, make_contact_sheet
from laesi_tf.reporting.overlay import PREDICTED_COLOUR, TRUE_COLOUR, draw_outlines, write_png

WORST = 12
_TILE = 420

Figures = Mapping[str, float | int | None]


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError, also when not a single photo can be read."""
    options = _parser().parse_args(arguments)
    photos = read_manifest(options.photos, split=options.split)
    estimator = load_estimator(options.model, mask_run=options.mask_model)
    table, worst = options.out / "photos.csv", options.out / "worst.png"
    for path in (table, worst, options.json):
        if path is not None:
            require_writable(path)
    scores = score_photos(estimator, photos)
    summaries = {name: summarise(group) for name, group in group_by_subset(scores).items()}
    _write_table(table, scores)
    written = [table]
    if ranked := sort_worst_first(scores)[:WORST]:
        write_png(worst, make_contact_sheet([_tile(estimator, score) for score in ranked]))
        written.append(worst)
    if options.json is not None:
        write_json(options.json, summaries)
    _report(scores, summaries)
    print("written:", ", ".join(sanitise_text(path) for path in written))


def _parser() -> argparse.ArgumentParser:
    made = make_parser("evaluate", __doc__)
    add_model_arguments(made)
    made.add_argument(
        "--photos", type=Path, required=True, metavar="CSV", help="manifest: image,area_cm2,..."
    )
    made.add_argument("--split", help="only this split of the manifest")
    made.add_argument(
        "--out",
        type=Path,
        default=Path("evaluation"),
        metavar="DIR",
        help="folder for photos.csv and worst.png",
    )
    return made


def _tile(estimator: Estimator, score: PhotoScore) -> np.ndarray:
    """The photo of `score` with its true and predicted outlines, measured again: outlines are not kept."""
    image, mask = load_photo_and_mask(score.photo)
    measured = estimator.measure(image, photo_info(score.photo))
    outlines = [] if mask is None else [(trace_largest_contour(mask), TRUE_COLOUR)]
    rings = [ring for leaf in measured.leaves for ring in (leaf.outline, *leaf.holes) if ring is not None]
    outlines += [(ring, PREDICTED_COLOUR) for ring in rings]
    said = f"true {score.photo.area_cm2:.2f}"
    if score.predicted_cm2 is not None:
        said += f", predicted {score.predicted_cm2:.2f} cm² ({score.relative_error:+.1f} %)"
    if score.iou is not None:
        said += f", IoU {score.iou:.3f}"
    return add_caption(draw_outlines(image, outlines, side=_TILE), [said, sanitise_text(score.photo.name)])


def _write_table(path: Path, scores: Sequence[PhotoScore]) -> None:
    header = (
        "image,subset,split,grid_mm,true_cm2,predicted_cm2,relative_error_percent,iou,mask_pixel_error,"
        "method,refused,error"
    )
    write_csv(path, header.split(","), (_cells(score) for score in scores))


def _cells(score: PhotoScore) -> tuple[object, ...]:
    photo = score.photo
    return (
        *(photo.name, photo.subset, photo.split, photo.grid_mm, photo.area_cm2),
        *(score.predicted_cm2, score.relative_error, score.iou, score.pixel_error),
        *(score.method, score.refusal, score.error),
    )


def _report(scores: Sequence[PhotoScore], summaries: Mapping[str, Figures]) -> None:
    """Print the table of subsets, then what a reader must know before believing it."""
    width = max(len(sanitise_text(name)) for name in summaries)
    columns = "    n  MRE %  [95 % interval]  median %   p90 %   mIoU     MPE  refused  skipped"
    print(f"{'subset':<{width}} {columns}")
    for name, figures in summaries.items():
        print(f"{sanitise_text(name):<{width}} {_line(figures)}")
    print(f"measured by {', '.join(sorted({score.method for score in scores if score.method}))}")
    other = sum(score.photo.grid_mm != 1.0 for score in scores)
    if other:
        print(f"{other} of {len(scores)} photos are not on 1 mm paper, the domain of models trained on it")
    for score in scores:
        if score.error is not None:
            print(f"skipped {sanitise_text(score.photo.name)}: {sanitise_text(score.error)}")


def _line(figures: Figures) -> str:
    """One row of the table, in the columns that `_report` names."""
    span = f"[{_cell(figures['mre_low'], 2)}, {_cell(figures['mre_high'], 2)}]"
    return (
        f"{figures['n']:5}  {_cell(figures['mre'], 2):>5}  {span:>15}  {_cell(figures['median'], 2):>8}  "
        f"{_cell(figures['p90'], 2):>6}  {_cell(figures['miou'], 3):>5}  {_cell(figures['mpe'], 3):>6}  "
        f"{figures['refused']:>7}  {figures['skipped']:>7}"
    )


def _cell(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


if __name__ == "__main__":
    run_command(main)
