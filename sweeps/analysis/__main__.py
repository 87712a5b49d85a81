"""Say what a sweep found: tables, pictures and a page of findings in a folder.

With --storage its studies are first written there as CSV with their seeds: screening.csv, and where there
are such studies finalists.csv, spread.csv and search.csv. Without, the CSV files that are there are
analysed again.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int

# isort: split


from sweeps.analysis import trial_table
from sweeps.analysis.pipeline import PAGE, STUDIES, analyse, export_studies
from sweeps.analysis.trial_table import TrialRecord


def main(arguments: Sequence[str]) -> None:
    """Export where asked, analyse, tell."""
    options = _make_parser().parse_args(arguments)
    if options.json:
        require_writable(options.json)
    if options.storage:
        export_studies(options.storage, options.out, {name: getattr(options, name) for name in STUDIES})
    found = {name: _read_table(options.out, name) for name in STUDIES}
    if not found["screening"]:
        raise InputError(f"no screening.csv in {options.out}: name the --storage of a finished sweep")
    figures = analyse(found, options.out, replays=options.replays)
    print((options.out / PAGE).read_text(encoding="utf-8"))
    if options.json:
        write_json(options.json, figures)


def _read_table(out: Path, name: str) -> list[TrialRecord]:
    path = out / f"{name}.csv"
    return trial_table.read_trials(path) if path.is_file() else []


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("analysis", __doc__, package="sweeps")
    made.add_argument(
        "--storage", help="where the studies are: a file, or postgresql://USER@HOST:PORT/DATABASE"
    )
    made.add_argument(
        "--out", type=Path, default=Path("sweeps/results"), metavar="FOLDER", help="for all of it"
    )
    for table, study in STUDIES.items():
        made.add_argument(f"--{table}", default=study, metavar="STUDY", help=f"the study of {table}.csv")
    made.add_argument(
        "--replays", type=positive_int, default=20, help="times that TPE is replayed on the grid"
    )
    return made


if __name__ == "__main__":
    run_command(main)
