"""Find out where methods fail: one nuisance at a time from none to absurd, everything else fixed.

Nuisances are applied to calm scenes of millimetre paper and, where they can be, to photographs of known
area with masks. Writes stress.csv, one row for each nuisance, severity, method and set, and stress.html.
Run the same command again to continue a run that was stopped.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.comparison_arguments import add_method_arguments, add_photo_set_arguments
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_csv, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.hardware import describe_hardware, format_hardware
from laesi_tf.common.parsing import image_size, non_negative_int, positive_int, select_by_name
from laesi_tf.data.manifest import read_photo_sets

_TRIALS_FILE = "stress.trials"
_SCENES = "calm scenes"
"""Name of the set of scenes."""
_FAILURES = 24


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    sets = read_photo_sets(options.photos)
    if _SCENES in sets:
        raise InputError(f"a set is called {_SCENES!r}, as the synthetic ones are; rename its folder")
    table, page = options.out / "stress.csv", options.out / "stress.html"
    for path in (table, page):
        require_writable(path)
    load_tensorflow()
    from laesi_tf.benchmarks.methods import SHIPPED, list_methods
    from laesi_tf.benchmarks.stress import failures, nuisances, sources, summary, trials
    from laesi_tf.reporting.stress_page import StressReport, list_breakdowns, write_stress_page

    methods = select_by_name(list_methods(options.models), options.methods, "method")
    chosen = select_by_name(nuisances.NUISANCES, options.nuisances, "nuisance")
    pictures: dict[str, sources.Source] = {
        _SCENES: sources.SceneSource(options.pictures, seed=options.seed, size=options.size)
    }
    for name, photos in sets.items():
        pictures[name] = sources.PhotoSource(photos, options.pictures, seed=options.seed)
    settings = {"pictures": options.pictures, "seed": options.seed, "size": list(options.size)}
    digests = {name: source.digest for name, source in pictures.items()}
    digests |= {method.name: method.digest for method in methods}
    digests |= {nuisance.name: nuisance.digest for nuisance in chosen}
    file = trials.TrialFile(options.out / _TRIALS_FILE, settings, digests)
    # The shipped method comes first in the report.
    ordered = sorted(methods, key=lambda method: method.name != SHIPPED)
    estimators = {method.name: method.load() for method in ordered}
    results = trials.run_trials(file, pictures, chosen, estimators)
    rows = summary.summarise_trials(results, chosen)
    breakdowns = summary.find_breakdowns(rows)
    hardware = describe_hardware()
    report = StressReport(
        facts=(
            f"{options.pictures} pictures a set, scenes of {options.size[1]} x {options.size[0]} pixels",
            f"seed {options.seed}",
            format_hardware(hardware),
        ),
        rows=summary.index_rows(rows),
        breakdowns=breakdowns,
        risk=summary.measure_risk(results),
        set_aside=summary.SET_ASIDE,
        failures=failures.draw_first_failures(results, pictures, chosen, estimators, limit=_FAILURES),
    )
    write_csv(table, summary.COLUMNS, ([row[name] for name in summary.COLUMNS] for row in rows))
    write_stress_page(page, report)
    if options.json is not None:
        write_json(
            options.json,
            {"rows": rows, "breakdowns": breakdowns, "risk": report.risk, **settings, **hardware},
        )
    for method in estimators:
        _print_breakdowns(method, *list_breakdowns(breakdowns, method))
    print("written:", ", ".join(map(str, (table, page))))


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("stress", __doc__)
    add_photo_set_arguments(parser, required=False)
    add_method_arguments(parser)
    parser.add_argument(
        "--nuisances", nargs="+", default=[], metavar="NAME", help="only these nuisances (default: all)"
    )
    parser.add_argument("--pictures", type=positive_int, default=12, metavar="N", help="pictures of each set")
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of scenes and nuisances")
    parser.add_argument(
        "--size", type=image_size, default=(1024, 1024), metavar="PX", help="SIDE or HEIGHTxWIDTH of scenes"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("stress"), metavar="DIR", help="folder for the results"
    )
    return parser


def _print_breakdowns(method: str, header: Sequence[str], table: Sequence[Sequence[str]]) -> None:
    print(f"{method} breaks at:")
    widths = [max(len(row[column]) for row in (header, *table)) for column in range(len(header))]
    for row in (header, *table):
        print("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip())
    print()


if __name__ == "__main__":
    run_command(main)
