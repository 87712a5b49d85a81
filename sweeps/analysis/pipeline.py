"""Export the studies of a sweep as CSV, analyse them, write tables, charts and the page of findings."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import optuna

from laesi_tf.common.atomic_files import read_json, write_csv, write_json, write_text
from sweeps.analysis import (
    charts,
    effects,
    findings,
    ranking,
    screening_findings,
    search_cost,
    trial_table,
)
from sweeps.analysis.trial_table import TrialRecord
from sweeps.queue.study_storage import open_existing_storage
from sweeps.trials.search_space import POINTS

PAGE = "README.md"
STUDIES = {"screening": "grid", "finalists": "finalists", "spread": "spread", "search": "tpe"}
"""The tables, and the studies that they come from unless an option names others."""
_QUANTILES = (0.1, 0.5, 0.9)
_SEARCH_TRIALS = 200
"""Length of the searches that are compared."""
_INTRODUCTION = """# What the sweep found

Written by `python -m sweeps.analysis` from the CSV files in this folder, which hold the trials. Lower MRE is
better. Intervals are 95 % confidence intervals, simultaneous over the levels of a factor, the pairs of two
factors, or the finalists. A change in percent is relative to the MRE: -10 % takes 50 % to 45 %. A difference
that is not significant may still exist. The screening has one seed and one set of images for all points: its
intervals do not cover other seeds and images. All trials use synthetic images and a budget far below a full
training: these findings are about the start of a training.
"""


@dataclass
class _Report:
    """The page, its charts, and the figures that it is written from."""

    lines: list[str]
    charts: list[str] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)


def export_studies(location: str, out: Path, studies: Mapping[str, str]) -> None:
    """Write those of `studies`, by the name of their table, that the storage has.

    Raises InputError if the storage or the study of the screening is missing.
    """
    storage = open_existing_storage(location)
    storage.require_study(studies["screening"])
    names = storage.study_names()
    for table, name in studies.items():
        if name in names:
            study = optuna.load_study(study_name=name, storage=storage.rdb)
            trials = study.get_trials(deepcopy=False)
            trial_table.write_trials(out / f"{table}.csv", trials)
            trial_table.write_failures(out / f"{table}_failures.csv", trials)
            write_json(out / f"{table}.json", study.user_attrs)


def analyse(tables: Mapping[str, list[TrialRecord]], out: Path, *, replays: int) -> dict[str, Any]:
    """Write tables, charts and the page for the trials of each study; return the figures."""
    screened = tables["screening"]
    attributes = {name: _read_study_attributes(out, name) for name, records in tables.items() if records}
    studies = [findings.describe_study(name, tables[name], about) for name, about in attributes.items()]
    report = _Report([_INTRODUCTION, *studies, ""])
    _analyse_screening(report, screened, out)
    _analyse_finalists(report, screened, tables["finalists"], out)
    _analyse_repeats(report, screened, tables["spread"], out)
    if search_cost.is_complete_grid(screened):
        steps = attributes.get("search", {}).get("budget", {}).get("steps", 1)
        _analyse_search_cost(report, screened, tables["search"], out, steps=steps, replays=replays)
    images = [f"![{Path(name).stem.replace('_', ' ')}]({name})\n" for name in report.charts]
    write_text(out / PAGE, "\n".join([*report.lines, "## Charts", "", *images]))
    return report.figures


def _analyse_screening(report: _Report, screened: Sequence[TrialRecord], out: Path) -> None:
    part = effects.select_balanced_part(screened)
    model = effects.estimate_effects(part) if effects.has_enough_factors(part) else None
    report.figures["missing_points"] = len(POINTS) - len({record.number for record in screened})
    report.lines += screening_findings.describe_screening(screened, part, model)
    if model:
        report.figures |= {
            "shares": model.shares,
            "residual": model.residual,
            "main_effects": [dataclasses.asdict(effect) for effect in model.main],
        }
        _write_effects(out / "main_effects.csv", model.main)
        _write_effects(out / "interactions.csv", model.pairs)
        charts.plot_main_effects(out / "main_effects.png", model.main)
        report.charts.append("main_effects.png")
    charts.plot_parallel_coordinates(out / "parallel.png", screened)
    report.charts.append("parallel.png")
    if model and (pairs := screening_findings.notable_interactions(model)):
        charts.plot_interactions(out / "interactions.png", model.pairs, pairs)
        report.charts.append("interactions.png")


def _analyse_finalists(
    report: _Report, screened: Sequence[TrialRecord], records: Sequence[TrialRecord], out: Path
) -> None:
    finalists = ranking.compare_finalists(screened, records)
    if len(finalists) < 2:
        return
    correlations = ranking.rank_correlations(finalists)
    report.figures["finalists"] = [dataclasses.asdict(finalist) for finalist in finalists]
    report.figures["agreement"] = [dataclasses.asdict(correlation) for correlation in correlations]
    charts.plot_rank_agreement(out / "ranks.png", finalists)
    report.charts.append("ranks.png")
    left_out = len({record.number for record in records}) - len(finalists)
    seeds = len({record.replicate for record in records})
    report.lines += findings.describe_finalists(finalists, correlations, seeds, left_out)


def _analyse_repeats(
    report: _Report, screened: Sequence[TrialRecord], records: Sequence[TrialRecord], out: Path
) -> None:
    repeats = ranking.pair_with_screening(screened, records)
    if len(repeats) < 2:
        return
    correlations = ranking.rank_correlations(repeats)
    report.figures["spread"] = [dataclasses.asdict(point) for point in repeats]
    report.figures["agreement_over_the_ranking"] = [
        dataclasses.asdict(correlation) for correlation in correlations
    ]
    charts.plot_rank_agreement(out / "spread.png", repeats)
    report.charts.append("spread.png")
    seeds = len({record.replicate for record in records})
    report.lines += findings.describe_repeats(repeats, correlations, seeds)


def _analyse_search_cost(
    report: _Report,
    screened: Sequence[TrialRecord],
    search: Sequence[TrialRecord],
    out: Path,
    *,
    steps: int,
    replays: int,
) -> None:
    errors = np.array([record.mre for record in screened])
    random = search_cost.random_search_quantiles(errors, _SEARCH_TRIALS, _QUANTILES)
    tpe = search_cost.replay_tpe(screened, _SEARCH_TRIALS, replays)
    pruned = search_cost.accumulate_lowest(search, steps) if search else None
    charts.plot_search_cost(out / "spending.png", random, tpe, pruned, steps=steps)
    report.charts.append("spending.png")
    report.lines += findings.describe_search_cost(random, tpe, pruned, steps)


def _write_effects(path: Path, rows: Sequence[effects.Effect]) -> None:
    cells = [[e.factor, e.level, round(e.change, 3), round(e.low, 3), round(e.high, 3)] for e in rows]
    write_csv(path, ["factor", "level", "change_percent", "low", "high"], cells)


def _read_study_attributes(out: Path, table: str) -> dict[str, Any]:
    """Return the exported attributes of a study; empty if there are none."""
    path = out / f"{table}.json"
    return dict(read_json(path)) if path.is_file() else {}
