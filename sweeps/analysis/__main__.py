"""Analyse a sweep: write tables, charts and a page of findings to a folder.

With --storage its studies are first written there as CSV with their seeds: screening.csv and, for studies
that exist, finalists.csv, spread.csv and search.csv. Without --storage the CSV files of the folder are
analysed again. Of an unfinished sweep the complete part is analysed; the page says how much is missing.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int
from sweeps.analysis import trial_table
from sweeps.analysis.pipeline import PAGE, STUDIES, analyse, export_studies
from sweeps.analysis.trial_table import TrialRecord
from sweeps.queue.study_storage import quiet_optuna


def main(arguments: Sequence[str]) -> None:
    """Export the studies if asked, analyse them, print the page."""
    options = _make_parser().parse_args(arguments)
    require_writable(options.out / PAGE)
    quiet_optuna()
    if options.storage:
        export_studies(options.storage, options.out, {name: getattr(options, name) for name in STUDIES})
    tables = {name: _read_table(options.out, name) for name in STUDIES}
    if not tables["screening"]:
        raise InputError(
            f"{options.out} has no screening.csv with a completed trial; name the --storage of a sweep"
        )
    figures = analyse(tables, options.out, replays=options.replays)
    print((options.out / PAGE).read_text(encoding="utf-8"))
    if options.json:
        write_json(options.json, figures)


def _read_table(folder: Path, name: str) -> list[TrialRecord]:
    path = folder / f"{name}.csv"
    return trial_table.read_trials(path) if path.is_file() else []


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("analysis", __doc__, package="sweeps")
    parser.add_argument(
        "--storage", help="storage of the studies: a file, or postgresql://USER@HOST:PORT/DATABASE"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("sweeps/results"),
        metavar="FOLDER",
        help="folder of tables and charts",
    )
    for table, study in STUDIES.items():
        parser.add_argument(f"--{table}", default=study, metavar="STUDY", help=f"study of {table}.csv")
    parser.add_argument(
        "--replays", type=positive_int, default=20, help="how often TPE is replayed on the grid"
    )
    return parser


if __name__ == "__main__":
    run_command(main)
