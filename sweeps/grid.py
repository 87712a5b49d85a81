"""Print the 1,425 points of the search space as CSV, or write them to a file."""

from collections.abc import Sequence

from laesi_tf.cli.arguments import make_parser, output_file
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import write_csv, write_json
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS, Point

_HEADER = ("number", *FACTORS, "augmentations", "learning_rate", "final_learning_rate", "paper_optimum")


def main(arguments: Sequence[str]) -> None:
    """Print the points as CSV, or write them to a file."""
    parser = make_parser("grid", __doc__, package="sweeps")
    parser.add_argument(
        "--out", type=output_file, metavar="FILE", help="write the CSV to FILE instead of printing"
    )
    options = parser.parse_args(arguments)
    rows = [_format_row(number, point) for number, point in enumerate(POINTS)]
    if options.json:
        write_json(options.json, [dict(zip(_HEADER, row, strict=True)) for row in rows])
    if options.out:
        write_csv(options.out, _HEADER, rows)
    else:
        print("\n".join(",".join(map(str, row)) for row in [_HEADER, *rows]))


def _format_row(number: int, point: Point) -> list[str | int | float]:
    # Plus signs between the names keep the cell free of commas.
    augmentations = "+".join(point.augmentations)
    final_rate = point.learning_rate if point.schedule == "constant" else point.final_learning_rate
    return [
        number,
        *point.levels.values(),
        augmentations,
        point.learning_rate,
        float(f"{final_rate:.6g}"),
        int(point == OPTIMUM),
    ]


if __name__ == "__main__":
    run_command(main)
