"""Export the studies of a sweep as CSV, analyse them, write tables, charts and the page of findings."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import read_json, write_csv, write_json, write_text
from laesi_tf.common.errors import InputError

# isort: split
import dataclasses

import numpy as np
import optuna

from sweeps.analysis import charts, effects, findings, ranking, search_cost, trial_table
from sweeps.analysis.trial_table import TrialRecord
from sweeps.queue.study_storage import RetryPolicy, StudyStorage

PAGE = "README.md"
STUDIES = {"screening": "grid", "finalists": "finalists", "spread": "spread", "search": "tpe"}
_QUANTILES = (0.1, 0.5, 0.9)
_INTRODUCTION = """# What the sweep found

Made by `python -m sweeps.analysis`; the trials are in the CSV files beside it. Lower MRE is better.
Intervals are 95 %, simultaneous over the levels of a factor, the pairs of two, or the finalists. A change in
percent is one of the MRE itself: -10 % takes 50 % to 45 %. What is not told apart may still differ. The
screening has one seed and one set of pictures for all points: its intervals say nothing of others. All
trials use synthetic pictures and a budget far below a full training: these are findings about its start.
"""


def export_studies(storage: str, out: Path, studies: dict[str, str]) -> None:
    """Write each of `studies` that the storage has, by the name of its table.

    Raises InputError where there is no such storage or no study of a screening in it.
    """
    if "://" not in storage and not Path(storage).is_file():
        raise InputError(f"no storage {storage}; name the --storage of a sweep")
    store = StudyStorage(storage, RetryPolicy())
    there = {study.study_name for study in optuna.get_all_study_summaries(store.storage)}
    if studies["screening"] not in there:
        told = ", ".join(sorted(there)) or "none"
        raise InputError(f"no study {studies['screening']} in {storage}; there are: {told}")
    for table, study in studies.items():
        if study in there:
            loaded = optuna.load_study(study_name=study, storage=store.storage)
            trials = loaded.get_trials(deepcopy=False)
            trial_table.write_trials(out / f"{table}.csv", trials)
            trial_table.write_failures(out / f"{table}_failures.csv", trials)
            write_json(out / f"{table}.json", loaded.user_attrs)


def analyse(found: dict[str, list[TrialRecord]], out: Path, *, replays: int) -> dict[str, Any]:
    """Write tables, pictures and the page for the trials of each study; the figures."""
    screened, told = (
        found["screening"],
        {name: _read_study_attributes(out, name) for name, rows in found.items() if rows},
    )
    page = [
        _INTRODUCTION,
        *(findings.describe_study(name, found[name], about) for name, about in told.items()),
        "",
    ]
    fitted = effects.estimate_effects(screened)
    figures: dict[str, Any] = {"shares": fitted.shares, "residual": fitted.residual}
    figures["main_effects"] = [dataclasses.asdict(effect) for effect in fitted.main]
    _write_effects(out / "main_effects.csv", fitted.main)
    _write_effects(out / "interactions.csv", fitted.pairs)
    charts.plot_main_effects(out / "main_effects.png", fitted.main)
    charts.plot_parallel_coordinates(out / "parallel.png", screened)
    page += findings.describe_screening(screened, fitted)
    pictures = ["main_effects.png", "parallel.png"]
    if names := findings.notable_interactions(fitted):
        charts.plot_interactions(out / "interactions.png", fitted.pairs, names)
        pictures.append("interactions.png")
    final = ranking.compare_finalists(screened, found["finalists"])
    if len(final) > 1:
        left_out = len({row.number for row in found["finalists"]}) - len(final)
        figures["finalists"] = [dataclasses.asdict(one) for one in final]
        figures["agreement"] = [dataclasses.asdict(one) for one in ranking.rank_correlations(final)]
        charts.plot_rank_agreement(out / "ranks.png", final)
        replicates = len({row.replicate for row in found["finalists"]})
        page += findings.describe_finalists(final, replicates, left_out)
        pictures.append("ranks.png")
    if found["spread"]:
        spread = ranking.pair_with_screening(screened, found["spread"])
        figures["spread"] = [dataclasses.asdict(one) for one in spread]
        figures["agreement_over_the_ranking"] = [
            dataclasses.asdict(one) for one in ranking.rank_correlations(spread)
        ]
        charts.plot_rank_agreement(out / "spread.png", spread)
        page += findings.describe_repeats(spread, len({row.replicate for row in found["spread"]}))
        pictures.append("spread.png")
    if search_cost.is_complete_grid(screened):
        steps = told.get("search", {}).get("budget", {}).get("steps", 1)
        page += _analyse_search_cost(screened, found["search"], out, steps=steps, replays=replays)
        pictures.append("spending.png")
    page += ["## Pictures", "", *(f"![{Path(name).stem.replace('_', ' ')}]({name})\n" for name in pictures)]
    write_text(out / PAGE, "\n".join(page))
    return figures


def _analyse_search_cost(
    screened: Sequence[TrialRecord], search: Sequence[TrialRecord], out: Path, *, steps: int, replays: int
) -> list[str]:
    count = 200
    random = search_cost.random_search_quantiles(np.array([row.mre for row in screened]), count, _QUANTILES)
    tpe = search_cost.replay_tpe(screened, count, replays)
    went = search_cost.running_best(search, steps) if search else None
    charts.plot_search_cost(out / "spending.png", random, tpe, went, steps=steps)
    return findings.describe_search_cost(random, tpe, went, steps)


def _write_effects(path: Path, found: Sequence[effects.Effect]) -> None:
    rows = [[e.factor, e.level, round(e.change, 3), round(e.low, 3), round(e.high, 3)] for e in found]
    write_csv(path, ["factor", "level", "change_percent", "low", "high"], rows)


def _read_study_attributes(out: Path, name: str) -> dict[str, Any]:
    """What a study keeps about itself, as it was exported; empty where it was not."""
    path = out / f"{name}.json"
    return read_json(path) if path.is_file() else {}
