"""Score an estimator on real photos of known leaf area, per subset of the manifest.

MRE, median and p90 are relative errors of the area in percent, over the photos that were not refused; mIoU
(the leaf's intersection over union) and MPE (relative error of the count of leaf pixels) are fractions, over
the photos that have a mask. n counts the photos that could be read.
"""

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.memory import return_large_blocks
from laesi_tf.cli.model_arguments import add_model_arguments, load_tensorflow_if_needed, model_options
from laesi_tf.cli.tensorflow_setup import suppress_stderr
from laesi_tf.common.atomic_files import require_distinct, require_writable, write_csv, write_json
from laesi_tf.common.text import round_for_table, sanitise_text
from laesi_tf.data.manifest import read_manifest
from laesi_tf.estimators.base import Estimator
from laesi_tf.evaluation.photo_scores import (
    ALL,
    PhotoScore,
    Summary,
    group_by_subset,
    load_photo_and_mask,
    photo_info,
    score_photos,
    sort_worst_first,
    summarise,
)

_MAX_TILES = 12
_TILE_PX = 420
_HEADER = (
    *("image", "subset", "split", "grid_mm", "true_cm2", "predicted_cm2", "uncertainty_cm2"),
    *("relative_error_percent", "scale_error_percent"),
    *("iou", "mask_pixel_error", "method", "refused", "error"),
)


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError, also when not a single photo can be read."""
    options = _make_parser().parse_args(arguments)
    photos = read_manifest(options.photos, split=options.split)
    table, worst = options.out / "photos.csv", options.out / "worst.png"
    inputs = [options.photos, *(path for photo in photos for path in (photo.image, photo.mask) if path)]
    require_distinct((table, worst, *([options.json] if options.json else [])), inputs)
    for path in (table, worst):
        require_writable(path)
    return_large_blocks()
    load_tensorflow_if_needed(options)
    from laesi_tf.estimators.factory import load_estimator

    with suppress_stderr():
        estimator = load_estimator(**model_options(options))
    scores = score_photos(estimator, photos)
    summaries = {name: summarise(group) for name, group in group_by_subset(scores).items()}
    write_csv(table, _HEADER, map(_make_row, scores))
    written = [table]
    if worst_scores := sort_worst_first(scores)[:_MAX_TILES]:
        _write_tiles(worst, estimator, worst_scores)
        written.append(worst)
    if options.json is not None:
        write_json(options.json, summaries)
    _print_report(scores, summaries)
    print("written:", ", ".join(sanitise_text(path) for path in written))


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("evaluate", __doc__)
    add_model_arguments(parser)
    parser.add_argument(
        "--photos", type=Path, required=True, metavar="CSV", help="manifest: image,area_cm2,..."
    )
    parser.add_argument("--split", help="only this split of the manifest")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("evaluation"),
        metavar="DIR",
        help="folder for photos.csv and worst.png",
    )
    return parser


def _write_tiles(path: Path, estimator: Estimator, scores: Sequence[PhotoScore]) -> None:
    """Write an image of the photos of `scores` with their outlines, measured again as they were not kept."""
    from laesi_tf.reporting.captions import add_caption, make_contact_sheet
    from laesi_tf.reporting.measurement_overlay import draw_comparison
    from laesi_tf.reporting.overlay import write_png

    tiles = []
    for score in scores:
        image, mask = load_photo_and_mask(score.photo)
        measurement = estimator.measure(image, photo_info(score.photo))
        tile = draw_comparison(image, measurement, mask, side=_TILE_PX)
        tiles.append(add_caption(tile, [_format_score(score), sanitise_text(score.photo.name)]))
    write_png(path, add_caption(make_contact_sheet(tiles), ["outlines: predicted magenta, true blue"]))


def _format_score(score: PhotoScore) -> str:
    text = f"true {score.photo.seen_cm2:.2f}"
    if score.predicted_cm2 is not None:
        text += f", predicted {score.predicted_cm2:.2f} cm² ({score.relative_error:+.1f} %)"
    return text if score.iou is None else f"{text}, IoU {score.iou:.3f}"


def _make_row(score: PhotoScore) -> tuple[object, ...]:
    photo = score.photo
    numbers = (
        *(photo.seen_cm2, score.predicted_cm2, score.uncertainty_cm2),
        *(score.relative_error, score.scale_error, score.iou, score.pixel_error),
    )
    return (
        *(photo.name, photo.subset, photo.split, photo.grid_mm),
        *map(round_for_table, numbers),
        *(score.method, score.refusal, score.error),
    )


def _print_report(scores: Sequence[PhotoScore], summaries: Mapping[str, Summary]) -> None:
    """Print the table of subsets, the methods, and the reasons to doubt the figures."""
    width = max(len(sanitise_text(name)) for name in summaries)
    columns = (
        "    n  MRE %  [95 % interval]  median %   p90 %   mIoU     MPE  within 1, 2 sd  > 10 % off  refused"
        "  skipped"
    )
    print(f"{'subset':<{width}} {columns}")
    for name, summary in summaries.items():
        print(f"{sanitise_text(name):<{width}} {_format_summary(summary)}")
    if summaries[ALL]["scale_median"] is not None:
        median, p90 = (_format(summaries[ALL][name], 3) for name in ("scale_median", "scale_p90"))
        print(f"scale read from the ruling, off from the manifest's: median {median} %, p90 {p90} %")
    print("photos by method:")
    for method, count in Counter(score.method for score in scores if score.method).most_common():
        print(f"{count:5}  {method}")
    for score in scores:
        if score.error is not None:
            print(f"skipped {sanitise_text(score.photo.name)}: {sanitise_text(score.error)}")


def _format_summary(summary: Summary) -> str:
    """Return one row of the table, in the columns that `_print_report` names."""
    interval = f"[{_format(summary['mre_low'], 2)}, {_format(summary['mre_high'], 2)}]"
    return (
        f"{summary['n']:5}  {_format(summary['mre'], 2):>5}  {interval:>15}  "
        f"{_format(summary['median'], 2):>8}  {_format(summary['p90'], 2):>6}  "
        f"{_format(summary['miou'], 3):>5}  {_format(summary['mpe'], 3):>6}  "
        f"{_format_percent(summary['within_1_sd']):>7}, {_format_percent(summary['within_2_sd']):>5}  "
        f"{summary['silent_errors']:>10}  {summary['refused']:>7}  {summary['skipped']:>7}"
    )


def _format_percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"


def _format(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


if __name__ == "__main__":
    run_command(main)
