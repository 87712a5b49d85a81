"""Measure speed and memory on this machine. Each benchmark has its own --help and --json FILE.

Machines drift: what is compared is measured alternately, several times, and reported as a median with its
interquartile range (IQR). A difference smaller than its IQR is noise.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.benchmark_arguments import add_photo_arguments, add_scene_arguments, report_figures
from laesi_tf.cli.comparison_arguments import add_method_arguments, add_photo_set_arguments
from laesi_tf.cli.console import run_command
from laesi_tf.cli.dataset_arguments import add_filter_arguments, add_ranges_argument
from laesi_tf.cli.model_arguments import add_model_arguments, load_tensorflow_if_needed, model_options
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_csv, write_figure, write_text
from laesi_tf.common.hardware import describe_hardware, format_hardware
from laesi_tf.common.parsing import non_negative_int, positive_int, select_by_name
from laesi_tf.data.manifest import read_manifest, read_photo_sets
from laesi_tf.data.photo_search import find_photos


def main(arguments: Sequence[str]) -> None:
    """Run the benchmark that the first argument names."""
    parser = make_parser("benchmark", __doc__, has_json=False)
    parser.add_argument(
        "benchmark", choices=tuple(BENCHMARKS), help="what to measure; BENCHMARK --help shows its arguments"
    )
    options = parser.parse_args(arguments[:1])
    BENCHMARKS[options.benchmark](arguments[1:])


def benchmark_synthesis(arguments: Sequence[str]) -> None:
    """Measure the speed of synthesis, alone, per component and during training, and its peak memory."""
    parser = make_parser("benchmark synthesis", benchmark_synthesis.__doc__)
    add_scene_arguments(parser, size=(224, 224))
    add_ranges_argument(parser)
    parser.add_argument(
        "--lighting-passes",
        type=positive_int,
        metavar="N",
        help="images of the same leaf in different light (default: that of the ranges; train uses 1)",
    )
    parser.add_argument(
        "--images", type=positive_int, default=20000, metavar="N", help="images for the memory measurement"
    )
    parser.add_argument(
        "--repeats",
        type=positive_int,
        default=5,
        metavar="N",
        help="repeats of each measurement; one repeat gives no interquartile range",
    )
    parser.add_argument("--steps", type=positive_int, default=20, metavar="N", help="timed steps per repeat")
    parser.add_argument(
        "--weights",
        choices=("auto", "imagenet", "none"),
        default="auto",
        help="weights of the networks, as for train",
    )
    options = parser.parse_args(arguments)
    load_tensorflow()
    from laesi_tf.benchmarks.synthesis_report import format_table, measure_synthesis
    from laesi_tf.synthesis import load_ranges

    ranges = load_ranges(options.ranges)
    metrics = measure_synthesis(
        ranges if options.lighting_passes is None else ranges.with_passes(options.lighting_passes),
        seed=options.seed,
        size=options.size,
        images=options.images,
        repeats=options.repeats,
        steps=options.steps,
        weights=options.weights,
    )
    report_figures(options, metrics, format_table(metrics))


def benchmark_photo(arguments: Sequence[str]) -> None:
    """Time how long it takes to decode a photo from its JPEG file and to measure it."""
    parser = make_parser("benchmark photo", benchmark_photo.__doc__)
    add_model_arguments(parser)
    add_scene_arguments(parser, size=(3000, 4000))
    parser.add_argument("--repeats", type=positive_int, default=20, metavar="N", help="number of photos")
    options = parser.parse_args(arguments)
    load_tensorflow()
    from laesi_tf.benchmarks.photo_speed import format_table, time_photos
    from laesi_tf.estimators.factory import load_estimator

    estimator = load_estimator(**model_options(options))
    metrics = time_photos(estimator, seed=options.seed, size=options.size, repeats=options.repeats)
    report_figures(options, metrics, format_table(metrics))


def benchmark_start(arguments: Sequence[str]) -> None:
    """Time `predict` from the start of its process to the first area, and measure its memory."""
    parser = make_parser("benchmark start", benchmark_start.__doc__)
    add_photo_arguments(parser, use=", a process for each photo")
    parser.add_argument(
        "--repeats", type=positive_int, default=5, metavar="N", help="processes for each photo"
    )
    options = parser.parse_args(arguments)
    photos = find_photos(options.photos).paths
    from laesi_tf.benchmarks import cold_start

    metrics = cold_start.time_starts(photos, repeats=options.repeats)
    report_figures(options, metrics, cold_start.format_table(metrics))


def benchmark_sensitivity(arguments: Sequence[str]) -> None:
    """Halve and double each parameter of an estimator; show how its error, coverage and refusals change."""
    parser = make_parser("benchmark sensitivity", benchmark_sensitivity.__doc__)
    add_model_arguments(parser)
    add_scene_arguments(parser, size=(1200, 1600))
    parser.add_argument(
        "--scenes", type=positive_int, default=40, metavar="N", help="scenes of different leaves to measure"
    )
    parser.add_argument(
        "--photos", type=Path, metavar="MANIFEST", help="measure these photos of known area, not scenes"
    )
    parser.add_argument("--split", metavar="NAME", help="split of the manifest")
    parser.add_argument(
        "--parameters",
        nargs="+",
        default=[],
        metavar="PREFIX",
        help="only parameters whose names start like this, such as a stage (default: all)",
    )
    options = parser.parse_args(arguments)
    photos = None if options.photos is None else read_manifest(options.photos, split=options.split)
    load_tensorflow()
    from laesi_tf.benchmarks import sensitivity
    from laesi_tf.estimators.factory import load_estimator

    estimator = sensitivity.require_tunable(load_estimator(**model_options(options), in_keras=True))
    parameters = sensitivity.select_parameters(estimator.params, options.parameters)
    if photos is None:
        labelled = sensitivity.render_photos(options.scenes, seed=options.seed, size=options.size)
    else:
        labelled = sensitivity.load_photos(photos)
    base = sensitivity.measure_accuracy(estimator, labelled)
    results = list(sensitivity.measure_sensitivity(estimator, labelled, parameters))
    table = sensitivity.format_table(base, results, count=len(labelled))
    report_figures(options, sensitivity.to_json(base, results), table)


def benchmark_folder(arguments: Sequence[str]) -> None:
    """Measure a folder of many photos: speed and memory by the number of workers; the last run is killed."""
    parser = make_parser("benchmark folder", benchmark_folder.__doc__)
    add_photo_arguments(parser, use="; links to them are measured")
    parser.add_argument(
        "--count", type=positive_int, default=300, metavar="N", help="photos in the folder that is measured"
    )
    parser.add_argument(
        "--workers", type=positive_int, nargs="+", default=[1, 2], metavar="N", help="numbers of workers"
    )
    parser.add_argument(
        "--kills", type=non_negative_int, default=3, metavar="N", help="times that a run is killed, at random"
    )
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of the kills")
    options = parser.parse_args(arguments)
    photos = find_photos(options.photos).paths
    from laesi_tf.benchmarks import folder_speed

    metrics = folder_speed.time_folder(
        photos, count=options.count, workers=options.workers, kills=options.kills, seed=options.seed
    )
    report_figures(options, metrics, folder_speed.format_table(metrics))


def benchmark_fuzz(arguments: Sequence[str]) -> None:
    """Measure damaged and hostile files: no traceback, at most 10 s a file and 2 GB of memory."""
    parser = make_parser("benchmark fuzz", benchmark_fuzz.__doc__)
    add_photo_arguments(parser, use=", copies of which are damaged")
    parser.add_argument("--files", type=positive_int, default=200, metavar="N", help="files to make")
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of the damage")
    options = parser.parse_args(arguments)
    photos = find_photos(options.photos).paths
    from laesi_tf.benchmarks import fuzzed_files

    metrics = fuzzed_files.fuzz_predict(photos, count=options.files, seed=options.seed)
    report_figures(options, metrics, fuzzed_files.format_report(metrics))
    if not metrics["is_passed"]:
        raise SystemExit(1)


def benchmark_accuracy(arguments: Sequence[str]) -> None:
    """Measure the same photos with every method: error against speed, as a table and a chart."""
    parser = make_parser("benchmark accuracy", benchmark_accuracy.__doc__)
    add_photo_set_arguments(parser, required=True)
    add_method_arguments(parser)
    parser.add_argument(
        "--timed", type=positive_int, default=5, metavar="N", help="photos of 12 megapixels to time"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("accuracy"),
        metavar="DIR",
        help="folder for speed_accuracy.csv, .md and .png",
    )
    options = parser.parse_args(arguments)
    sets = read_photo_sets(options.photos)
    paths = {suffix: options.out / f"speed_accuracy.{suffix}" for suffix in ("csv", "md", "png")}
    for path in paths.values():
        require_writable(path)
    load_tensorflow()
    from laesi_tf.benchmarks import accuracy
    from laesi_tf.benchmarks.methods import list_methods
    from laesi_tf.reporting.accuracy_chart import format_report, plot_speed_accuracy

    methods = select_by_name(list_methods(options.models), options.methods, "method")
    rows = accuracy.compare_methods(methods, sets, timed=options.timed)
    by_set = {name: [row for row in rows if row["set"] == name] for name in sets}
    fronts = {name: accuracy.find_front(rows) for name, rows in by_set.items()}
    hardware = describe_hardware()
    text = format_report(f"{format_hardware(hardware)}; {options.timed} photos timed", by_set, fronts)
    write_csv(paths["csv"], accuracy.COLUMNS, ([row[name] for name in accuracy.COLUMNS] for row in rows))
    write_text(paths["md"], f"{text}\n")
    write_figure(paths["png"], plot_speed_accuracy(by_set, fronts), dpi=130)
    written = ", ".join(map(str, paths.values()))
    report_figures(options, {"rows": rows, **hardware}, f"{text}\nwritten: {written}")


def benchmark_filter(arguments: Sequence[str]) -> None:
    """Repaint leaves with faults of all kinds and severities; count what the consistency filter rejects."""
    parser = make_parser("benchmark filter", benchmark_filter.__doc__)
    add_scene_arguments(parser, size=(224, 224))
    parser.add_argument(
        "--count", type=positive_int, default=200, metavar="N", help="images of each kind and severity"
    )
    add_ranges_argument(parser)
    add_filter_arguments(parser)
    parser.add_argument(
        "--textures",
        type=Path,
        metavar="DIR",
        help="photos with masks, from which the leaves are repainted first (default: leaves of the scenes)",
    )
    parser.add_argument("--textures-split", metavar="NAME", help="split of the manifest of --textures")
    options = parser.parse_args(arguments)
    if options.textures is not None:
        from laesi_tf.inpainting.donor_leaves import find_donor_photos

        find_donor_photos(options.textures, split=options.textures_split)
    load_tensorflow()
    from laesi_tf.benchmarks import filter_faults

    metrics = filter_faults.measure_filter(
        count=options.count,
        seed=options.seed,
        size=options.size,
        ranges=options.ranges,
        max_deviation=options.max_deviation,
        mask_run=options.mask_run,
        textures=options.textures,
        textures_split=options.textures_split,
    )
    report_figures(options, metrics, filter_faults.format_table(metrics))


def benchmark_leaves(arguments: Sequence[str]) -> None:
    """Count the leaves that are missed on photos of several: those of other photos are pasted beside each."""
    parser = make_parser("benchmark leaves", benchmark_leaves.__doc__)
    add_model_arguments(parser)
    parser.add_argument(
        "--photos", type=Path, required=True, metavar="MANIFEST", help="photos of one leaf each, with masks"
    )
    parser.add_argument("--split", metavar="NAME", help="split of the manifest")
    parser.add_argument("--count", type=positive_int, default=100, metavar="N", help="photos to make")
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of what is pasted where")
    options = parser.parse_args(arguments)
    photos = read_manifest(options.photos, split=options.split)
    load_tensorflow_if_needed(options)
    from laesi_tf.benchmarks import pasted_leaves
    from laesi_tf.estimators.factory import load_estimator

    estimator = load_estimator(**model_options(options))
    metrics = pasted_leaves.measure_pasted_leaves(estimator, photos, count=options.count, seed=options.seed)
    report_figures(options, metrics, pasted_leaves.format_table(metrics))


BENCHMARKS: dict[str, Callable[[Sequence[str]], None]] = {
    "synthesis": benchmark_synthesis,
    "photo": benchmark_photo,
    "start": benchmark_start,
    "sensitivity": benchmark_sensitivity,
    "folder": benchmark_folder,
    "fuzz": benchmark_fuzz,
    "leaves": benchmark_leaves,
    "accuracy": benchmark_accuracy,
    "filter": benchmark_filter,
}

if __name__ == "__main__":
    run_command(main)
