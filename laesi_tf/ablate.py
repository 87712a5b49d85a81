"""Find out which components of a scene are worth what they cost.

Trains networks on scenes without each component, and on the barest scenes with that one alone, measures them
on photographs of known area, and sets the change of their errors against the time that the component takes.
Writes ablation.csv and ablation.png. Run the same command again to continue a run that was stopped.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.comparison_arguments import add_photo_set_arguments
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_csv, write_figure, write_json
from laesi_tf.common.hardware import describe_hardware, format_hardware
from laesi_tf.common.parsing import image_size, positive_int
from laesi_tf.data.manifest import digest_photos, read_photo_sets
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import TASKS

_COST_REPEATS = 3


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    sets = read_photo_sets(options.photos)
    table, chart = options.out / "ablation.csv", options.out / "ablation.png"
    for path in (table, chart):
        require_writable(path)
    recipe: dict[str, Any] = {
        "size": options.size,
        "steps": options.steps,
        "weights": options.weights,
        "validate_every": options.steps,
        "checkpoint_every": options.steps,
        "validation_pictures": options.validation_pictures,
    }
    load_tensorflow()
    from laesi_tf.benchmarks import ablation
    from laesi_tf.benchmarks.component_cost import measure_component_cost
    from laesi_tf.benchmarks.timing import MedianIqr
    from laesi_tf.reporting.ablation_chart import plot_ablation
    from laesi_tf.synthesis import load_ranges
    from laesi_tf.synthesis.presets import enable_all_components
    from laesi_tf.synthesis.ranges_toml import ranges_to_toml

    groups = ablation.read_groups(options.ranges, options.components)
    variants = ablation.list_variants(options.ranges, groups)
    tasks = list(dict.fromkeys(options.tasks))
    ablation.require_labels(tasks, sets)
    base = load_ranges(options.ranges)
    settings = recipe | {
        "ranges": ranges_to_toml(base),
        "sets": {name: digest_photos(photos) for name, photos in sets.items()},
    }
    runner = ablation.AblationRunner(
        out=options.out, config=TrainConfig(**recipe), sets=sets, settings=settings
    )
    runner.read_networks()
    complete = enable_all_components(base).with_passes(1)

    def measure_costs() -> dict[str, MedianIqr]:
        return measure_component_cost(complete, groups, repeats=_COST_REPEATS, seed=0, size=options.size)

    print(f"{len(tasks) * len(variants) * options.seeds} networks")
    rows = ablation.run_ablation(runner, tasks, variants, range(options.seeds), measure_costs)
    write_csv(table, ablation.COLUMNS, ([row[name] for name in ablation.COLUMNS] for row in rows))
    write_figure(chart, plot_ablation(rows), dpi=130)
    if options.json is not None:
        write_json(options.json, {"rows": rows, **recipe, **describe_hardware()})
    _print_rows(rows)
    print(format_hardware(describe_hardware()))
    print("written:", ", ".join(map(str, (table, chart))))


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("ablate", __doc__)
    add_photo_set_arguments(parser, required=True)
    parser.add_argument(
        "--tasks", nargs="+", choices=tuple(TASKS), default=["mask"], metavar="TASK", help="networks to train"
    )
    parser.add_argument("--ranges", default="phone", metavar="PRESET|FILE", help="scenes with all components")
    parser.add_argument(
        "--components",
        nargs="+",
        default=[],
        metavar="NAME",
        help="only these components, or groups: NAME=COMPONENT+COMPONENT (default: each component)",
    )
    parser.add_argument("--seeds", type=positive_int, default=3, metavar="N", help="trainings of each scene")
    parser.add_argument("--steps", type=positive_int, default=300, metavar="N", help="steps of each training")
    parser.add_argument(
        "--size", type=image_size, default=(224, 224), metavar="PX", help="SIDE or HEIGHTxWIDTH of images"
    )
    parser.add_argument("--weights", default="auto", metavar="PATH|NAME", help="as for train")
    parser.add_argument(
        "--validation-pictures",
        type=positive_int,
        default=64,
        metavar="N",
        help="fresh scenes that each training ends with; the photographs decide",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("ablation"), metavar="DIR", help="folder of the results"
    )
    return parser


def _print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    print(f"{'':36}{'component':20}{'change':>9}{'value':>10}{'difference':>12}   95 % interval")
    for row in rows:
        difference = "" if row["difference"] is None else f"{row['difference']:+.4g}"
        interval = "" if row["low"] is None else f"[{row['low']:+.4g}, {row['high']:+.4g}]"
        cells = f"{row['component']:20}{row['change']:>9}{row['value']:>10.4g}{difference:>12}   {interval}"
        print(f"{', '.join((row['task'], row['set'], row['metric'])):36}{cells}")


if __name__ == "__main__":
    run_command(main)
