"""Say what a sweep found: tables, pictures and a page of findings in a folder.

With --storage its studies are first written there as CSV with their seeds: screening.csv, and where there
are such studies finalists.csv, spread.csv and search.csv. Without, the CSV files that are there are
analysed again.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli import parser, positive, run

# isort: split
import dataclasses

import numpy as np
import optuna

from laesi_tf.errors import InputError
from laesi_tf.files import read_json, require_writable, write_csv, write_json, write_text
from sweeps import charts, effects, findings, ranks, spending, tables
from sweeps.store import Rules, Store
from sweeps.tables import Row

PAGE = "README.md"
_STUDIES = {"screening": "grid", "finalists": "finalists", "spread": "spread", "search": "tpe"}
_QUANTILES = (0.1, 0.5, 0.9)
_INTRODUCTION = """# What the sweep found

Made by `python -m sweeps.analysis`; the trials are in the CSV files beside it. Lower MRE is better.
Intervals are 95 %, simultaneous over the levels of a factor, the pairs of two, or the finalists. A change in
percent is one of the MRE itself: -10 % takes 50 % to 45 %. What is not told apart may still differ. The
screening has one seed and one set of pictures for all points: its intervals say nothing of others. All
trials use synthetic pictures and a budget far below a full training: these are findings about its start.
"""


def main(arguments: Sequence[str]) -> None:
    """Export where asked, analyse, tell."""
    options = _options().parse_args(arguments)
    if options.json:
        require_writable(options.json)
    if options.storage:
        export(options.storage, options.out, {name: getattr(options, name) for name in _STUDIES})
    found = {name: _table(options.out, name) for name in _STUDIES}
    if not found["screening"]:
        raise InputError(f"no screening.csv in {options.out}: name the --storage of a finished sweep")
    figures = analyse(found, options.out, replays=options.replays)
    print((options.out / PAGE).read_text(encoding="utf-8"))
    if options.json:
        write_json(options.json, figures)


def export(storage: str, out: Path, studies: dict[str, str]) -> None:
    """Write each of `studies` that the storage has, by the name of its table.

    Raises InputError where there is no such storage or no study of a screening in it.
    """
    if "://" not in storage and not Path(storage).is_file():
        raise InputError(f"no storage {storage}; name the --storage of a sweep")
    store = Store(storage, Rules())
    there = {study.study_name for study in optuna.get_all_study_summaries(store.storage)}
    if studies["screening"] not in there:
        told = ", ".join(sorted(there)) or "none"
        raise InputError(f"no study {studies['screening']} in {storage}; there are: {told}")
    for table, study in studies.items():
        if study in there:
            loaded = optuna.load_study(study_name=study, storage=store.storage)
            trials = loaded.get_trials(deepcopy=False)
            tables.write(out / f"{table}.csv", trials)
            tables.write_failures(out / f"{table}_failures.csv", trials)
            write_json(out / f"{table}.json", loaded.user_attrs)


def analyse(found: dict[str, list[Row]], out: Path, *, replays: int) -> dict[str, Any]:
    """Write tables, pictures and the page for the trials of each study; the figures."""
    screened, told = found["screening"], {name: _told(out, name) for name, rows in found.items() if rows}
    page = [_INTRODUCTION, *(findings.of_study(name, found[name], about) for name, about in told.items()), ""]
    fitted = effects.fit(screened)
    figures: dict[str, Any] = {"shares": fitted.shares, "residual": fitted.residual}
    figures["main_effects"] = [dataclasses.asdict(effect) for effect in fitted.main]
    _effects_csv(out / "main_effects.csv", fitted.main)
    _effects_csv(out / "interactions.csv", fitted.pairs)
    charts.main_effects(out / "main_effects.png", fitted.main)
    charts.parallel(out / "parallel.png", screened)
    page += findings.of_screening(screened, fitted)
    pictures = ["main_effects.png", "parallel.png"]
    if names := findings.worth_knowing(fitted):
        charts.interactions(out / "interactions.png", fitted.pairs, names)
        pictures.append("interactions.png")
    final = ranks.finals(screened, found["finalists"])
    if len(final) > 1:
        left_out = len({row.number for row in found["finalists"]}) - len(final)
        figures["finalists"] = [dataclasses.asdict(one) for one in final]
        figures["agreement"] = [dataclasses.asdict(one) for one in ranks.agreements(final)]
        charts.ranks(out / "ranks.png", final)
        replicates = len({row.replicate for row in found["finalists"]})
        page += findings.of_finalists(final, replicates, left_out)
        pictures.append("ranks.png")
    if found["spread"]:
        spread = ranks.again(screened, found["spread"])
        figures["spread"] = [dataclasses.asdict(one) for one in spread]
        figures["agreement_over_the_ranking"] = [dataclasses.asdict(one) for one in ranks.agreements(spread)]
        charts.ranks(out / "spread.png", spread)
        page += findings.of_spread(spread, len({row.replicate for row in found["spread"]}))
        pictures.append("spread.png")
    if spending.is_whole(screened):
        steps = told.get("search", {}).get("budget", {}).get("steps", 1)
        page += _spent(screened, found["search"], out, steps=steps, replays=replays)
        pictures.append("spending.png")
    page += ["## Pictures", "", *(f"![{Path(name).stem.replace('_', ' ')}]({name})\n" for name in pictures)]
    write_text(out / PAGE, "\n".join(page))
    return figures


def _spent(
    screened: Sequence[Row], search: Sequence[Row], out: Path, *, steps: int, replays: int
) -> list[str]:
    count = 200
    random = spending.best_of_random(np.array([row.mre for row in screened]), count, _QUANTILES)
    tpe = spending.best_of_tpe(screened, count, replays)
    went = spending.best_so_far(search, steps) if search else None
    charts.spending(out / "spending.png", random, tpe, went, steps=steps)
    return findings.of_spending(random, tpe, went, steps)


def _effects_csv(path: Path, found: Sequence[effects.Effect]) -> None:
    rows = [[e.factor, e.level, round(e.change, 3), round(e.low, 3), round(e.high, 3)] for e in found]
    write_csv(path, ["factor", "level", "change_percent", "low", "high"], rows)


def _table(out: Path, name: str) -> list[Row]:
    path = out / f"{name}.csv"
    return tables.read(path) if path.is_file() else []


def _told(out: Path, name: str) -> dict[str, Any]:
    """What a study keeps about itself, as it was exported; empty where it was not."""
    path = out / f"{name}.json"
    return read_json(path) if path.is_file() else {}


def _options() -> argparse.ArgumentParser:
    made = parser("analysis", __doc__, package="sweeps")
    made.add_argument(
        "--storage", help="where the studies are: a file, or postgresql://USER@HOST:PORT/DATABASE"
    )
    made.add_argument(
        "--out", type=Path, default=Path("sweeps/results"), metavar="FOLDER", help="for all of it"
    )
    for table, study in _STUDIES.items():
        made.add_argument(f"--{table}", default=study, metavar="STUDY", help=f"the study of {table}.csv")
    made.add_argument("--replays", type=positive, default=20, help="times that TPE is replayed on the grid")
    return made


if __name__ == "__main__":
    run(main)
