"""Write the paper's table with our results beside the paper's, and the error against the size of the data.

Writes table.md, table.csv, table.png and sizes.png. What has not been run is shown as missing.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from experiments import figures
from experiments.experiment_specs import load_experiments
from experiments.paths import DEFAULT_OUT
from experiments.results import collect_rows, read_settings, select_shown_rows
from experiments.table_text import (
    CAPTION,
    describe_setup,
    format_cells,
    make_csv,
    make_records,
    table_header,
    to_markdown,
    write_notes,
)
from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_csv, write_figure, write_json, write_text

_FILES = ("table.md", "table.csv", "table.png", "sizes.png")


def main(arguments: Sequence[str]) -> None:
    """Write the table and print it. Raises InputError without experiments or where a file is not writable."""
    options = _make_parser().parse_args(arguments)
    out = options.out or options.runs
    settings, rows = read_settings(options.runs), collect_rows(options.runs, load_experiments())
    for name in _FILES:
        require_writable(out / name)
    shown = select_shown_rows(rows)
    above, below = describe_setup(settings, options.caption), list(write_notes(rows))
    text = to_markdown(shown, settings, above, below)
    write_text(out / "table.md", text)
    write_csv(out / "table.csv", *make_csv(shown, settings))
    cells = [format_cells(row, settings) for row in shown]
    write_figure(out / "table.png", figures.draw_table(table_header(), cells, above, below), dpi=130)
    write_figure(out / "sizes.png", figures.plot_error_by_size(rows, above, settings["scale"]), dpi=130)
    if options.json is not None:
        write_json(options.json, {"notes": [*above, *below], "rows": make_records(shown, settings)})
    print(text)
    print("written:", ", ".join(str(out / name) for name in _FILES))


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("table", __doc__, package="experiments")
    parser.add_argument(
        "--runs", type=Path, default=DEFAULT_OUT, metavar="DIR", help="--out of experiments.run"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the table (default: that of --runs)"
    )
    parser.add_argument(
        "--caption", default=CAPTION, metavar="TEXT", help="what the photographs are, for the reader"
    )
    return parser


if __name__ == "__main__":
    run_command(main)
