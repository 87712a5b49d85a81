"""Measure the leaves on photos: cm2 per leaf, a CSV, and an overlay that shows what was found on each photo.

Leaves are numbered in reading order, in the table as in the overlay. The area is flat and one-sided, holes
subtracted, petiole included; the uncertainty is one standard deviation. Each result is kept as soon as it is
there: after an interruption the same command continues.
"""

import argparse
import contextlib
from collections.abc import Sequence

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.memory import return_large_blocks
from laesi_tf.cli.model_arguments import add_model_arguments, load_tensorflow_if_needed, model_options
from laesi_tf.cli.output_arguments import add_output_arguments, overlay_side
from laesi_tf.cli.scale_arguments import (
    OF_FILE,
    add_scale_arguments,
    check_scale_options,
    has_known_scale,
    scale_px_per_mm,
)
from laesi_tf.cli.tensorflow_setup import suppress_stderr
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int
from laesi_tf.common.text import sanitise_text
from laesi_tf.data.photo_search import PhotoSearch, find_photos
from laesi_tf.estimators.base import PhotoInfo
from laesi_tf.measuring.measure_photos import default_workers, measure_photos
from laesi_tf.measuring.photo_tasks import PhotoTask, make_tasks
from laesi_tf.measuring.provenance import describe_settings, list_models
from laesi_tf.measuring.results_folder import ResultsFolder
from laesi_tf.measuring.sample_names import describe_mismatches, name_photos, read_sample_names
from laesi_tf.measuring.summary import format_summary, summarise
from laesi_tf.measuring.summary_files import write_summary_files
from laesi_tf.reporting.record_tables import CSV_FORMATS


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError, also when not a single photo can be read."""
    options = _make_parser().parse_args(arguments)
    check_scale_options(options)
    side = overlay_side(options)
    given = None if options.names is None else read_sample_names(options.names)
    search = find_photos(options.photos, recursive=options.recursive)
    models = list_models(**model_options(options), has_known_scale=has_known_scale(options))
    settings = describe_settings(
        models, px_per_mm=options.px_per_mm, dpi=options.dpi, grid_mm=options.grid_mm
    )
    with ResultsFolder(
        options.out, settings, csv=options.csv, json_lines=options.jsonl, again=options.again
    ) as results:
        tasks = make_tasks(search.photos, results.overlays, foreign=results.list_foreign_files())
        names = name_photos(tasks, results.kept_options.names, given)
        todo = results.open(tasks, names, overlay_side=side)
        complete = False
        try:
            if todo:
                _measure(todo, results, options, side, finished=len(tasks) - len(todo))
            complete = True
        finally:
            # Also after Ctrl-C; on a full disk the journal is what remains.
            with contextlib.nullcontext() if complete else contextlib.suppress(InputError):
                write_summary_files(
                    results, models, json=options.json, passed_over=search.describe_passed_over()
                )
        about_table = [
            *results.kept_options.describe(without_csv=options.csv is None, without_names=given is None),
            *describe_mismatches(names, tasks, is_given=given is not None),
        ]
        _print_summary(results, search, about_table, reused=len(tasks) - len(todo))


def _measure(
    tasks: Sequence[PhotoTask],
    results: ResultsFolder,
    options: argparse.Namespace,
    side: int | None,
    *,
    finished: int,
) -> None:
    """Load the estimator and measure `tasks`."""
    return_large_blocks()
    load_tensorflow_if_needed(options)
    # Not before the arguments are parsed: --help need not wait for LiteRT.
    from laesi_tf.estimators import factory
    from laesi_tf.measuring.photo_worker import PhotoWorker

    with suppress_stderr():
        estimator = factory.load_estimator(**model_options(options), has_known_scale=has_known_scale(options))
    worker = PhotoWorker(
        estimator=estimator,
        folder=options.out,
        info=PhotoInfo(px_per_mm=scale_px_per_mm(options), grid_mm=options.grid_mm),
        uses_dpi_of_file=options.dpi == OF_FILE,
        overlay_side=side,
    )
    measure_photos(worker.measure, tasks, results, workers=options.workers, finished=finished)


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("predict", __doc__)
    parser.add_argument(
        "photos", nargs="+", metavar="PHOTO", help="a photo, a folder of photos, or a pattern such as *.jpg"
    )
    parser.add_argument("--recursive", action="store_true", help="measure the photos in all subfolders, too")
    add_model_arguments(parser)
    add_scale_arguments(parser)
    add_output_arguments(parser, csv_formats=tuple(CSV_FORMATS))
    parser.add_argument(
        "--workers",
        type=positive_int,
        default=default_workers(),
        metavar="N",
        help="photos that are measured at the same time; results do not depend on it (default: the number of "
        "cores, at most 8)",
    )
    return parser


def _print_summary(
    results: ResultsFolder, search: PhotoSearch, about_table: Sequence[str], *, reused: int
) -> None:
    """Print what was measured and what needs attention, the lines `about_table` last.

    Raises InputError if no photo can be read.
    """
    summary = summarise(results.read_entries())
    if summary.unreadable == summary.photos:
        others = summary.photos - 1
        more = f" (and none of the other {others} photos can be read)" if others else ""
        raise InputError(f"{summary.first_error}{more}")
    lines = format_summary(summary, table=results.table)
    if reused:
        lines.append(
            f"measured before, and unchanged since: {reused} of {summary.photos} photos "
            "(--again measures them anew)"
        )
    if others := results.count_others():
        lines.append(f"photos of earlier commands that are in the table, too: {others}")
    if results.kept_copy is not None:
        lines.append(f"the earlier table had been changed; it is kept as {results.kept_copy}")
    if passed_over := search.describe_passed_over():
        lines.append(f"passed over: {passed_over}")
    print("\n".join(map(sanitise_text, [*lines, *about_table])))


if __name__ == "__main__":
    run_command(main)
