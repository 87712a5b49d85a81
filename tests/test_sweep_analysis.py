"""The analysis claims what the trials show, and no more."""

import csv
import dataclasses
import itertools
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from sweep_studies import write_finished_study

from laesi_tf.common.errors import InputError
from sweeps.analysis import __main__ as command
from sweeps.analysis import (
    charts,
    effects,
    findings,
    pipeline,
    ranking,
    screening_findings,
    search_cost,
    trial_table,
)
from sweeps.analysis.ranking import Finalist, RepeatedPoint
from sweeps.analysis.trial_table import TrialRecord
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.trials.budget import SCREENING
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS, Point

MAIN_EFFECTS = {
    ("start", "small_imagenet"): -0.2,
    ("optimizer", "sgd"): 0.5,
    ("schedule", "constant"): 0.1,
}
INTERACTIONS = {("start", "large_scratch", "optimizer", "sgd"): 0.4}


@pytest.fixture(autouse=True)
def shorten_simulations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranking, "_RESAMPLES", 200)
    monkeypatch.setattr(pipeline, "_SEARCH_TRIALS", 60)


def simulate_error(point: Point, random: np.random.Generator, sigma: float = 0.05) -> float:
    """Return an MRE with known effects on its logarithm, and noise."""
    log = math.log(50.0) + sigma * random.normal()
    log += sum(change for (factor, level), change in MAIN_EFFECTS.items() if point.levels[factor] == level)
    for (one, first, other, second), change in INTERACTIONS.items():
        log += change * (point.levels[one] == first and point.levels[other] == second)
    return math.exp(log)


def simulate_screening(sigma: float = 0.05, seed: int = 0) -> list[TrialRecord]:
    random = np.random.default_rng(seed)
    return [
        TrialRecord(number, point, 0, simulate_error(point, random, sigma), 1.0)
        for number, point in enumerate(POINTS)
    ]


def describe_screening(records: Sequence[TrialRecord]) -> str:
    return "\n".join(
        screening_findings.describe_screening(records, records, effects.estimate_effects(records))
    )


def describe_finalists(finalists: Sequence[Finalist], seeds: int, left_out: int = 0) -> str:
    correlations = ranking.rank_correlations(finalists)
    return "\n".join(findings.describe_finalists(finalists, correlations, seeds, left_out))


def describe_repeats(points: Sequence[RepeatedPoint], seeds: int) -> str:
    return "\n".join(findings.describe_repeats(points, ranking.rank_correlations(points), seeds))


def test_effects_are_those_of_the_simulation() -> None:
    model = effects.estimate_effects(simulate_screening(sigma=1e-6))
    logs = {(effect.factor, effect.level): math.log1p(effect.change / 100) for effect in model.main}
    # Against the average over a factor's levels; the interaction adds to the main effects of its levels.
    small = MAIN_EFFECTS["start", "small_imagenet"]
    interaction = INTERACTIONS["start", "large_scratch", "optimizer", "sgd"]
    expected = small - small / 3 - interaction / 5 / 3
    assert logs["start", "small_imagenet"] == pytest.approx(expected, abs=1e-4)
    constant = MAIN_EFFECTS["schedule", "constant"]
    assert logs["schedule", "constant"] == pytest.approx(constant * 4 / 5, abs=1e-4)
    for level in FACTORS["augmentation"]:
        assert logs["augmentation", level] == pytest.approx(0, abs=1e-4)
    pair = next(effect for effect in model.pairs if effect.level == "large_scratch x sgd")
    expected = interaction * (1 - 1 / 3) * (1 - 1 / 5)
    assert math.log1p(pair.change / 100) == pytest.approx(expected, abs=1e-4)
    assert model.residual < 1e-6 and sum(model.shares.values()) + model.residual == pytest.approx(1)


def test_simultaneous_intervals_have_their_coverage() -> None:
    """No augmentation has an effect: nearly all sets of 19 simultaneous 95 % intervals include zero."""

    def has_false_positive(seed: int) -> bool:
        model = effects.estimate_effects(simulate_screening(seed=seed))
        return any(effect.is_significant for effect in model.main if effect.factor == "augmentation")

    assert sum(map(has_false_positive, range(10))) <= 3


def test_the_notable_interaction_is_that_of_the_simulation() -> None:
    model = effects.estimate_effects(simulate_screening())
    assert screening_findings.notable_interactions(model) == ["start x optimizer"]
    # A pair without any effect explains what chance does.
    pair = "schedule x augmentation"
    assert model.shares[pair] == pytest.approx(model.by_chance[pair], rel=0.5)
    page = describe_screening(simulate_screening())
    assert "- augmentation — no level differs significantly from the average." in page


def test_an_average_that_hides_an_interaction_is_marked() -> None:
    """From scratch is much better with SGD and worse with all others: on average it seems better."""

    def change_scratch(record: TrialRecord) -> TrialRecord:
        cell = record.point.start == "large_scratch", record.point.optimizer == "sgd"
        factor = {(True, True): 0.02, (True, False): 1.3}.get(cell, 1.0)
        return dataclasses.replace(record, mre=record.mre * factor)

    page = describe_screening([change_scratch(record) for record in simulate_screening()])
    assert re.search(r"- start — better: large_scratch.*depends on the optimizer", page)
    assert "by start and optimizer" in page


def test_effects_need_a_balanced_part_of_the_grid() -> None:
    records = simulate_screening()
    part = [record for record in records if record.point.start == "large_scratch"]
    assert {effect.factor for effect in effects.estimate_effects(part).main} == {
        "optimizer",
        "schedule",
        "augmentation",
    }
    with pytest.raises(InputError, match="too few for intervals"):
        effects.estimate_effects([record for record in part if record.point.optimizer == "adam"])
    with pytest.raises(InputError, match="not all"):
        effects.estimate_effects(records[:20])


def test_the_balanced_part_of_an_unfinished_grid_lacks_the_unfinished_levels() -> None:
    records = simulate_screening()
    assert effects.select_balanced_part(records) == records
    unfinished = [
        record
        for record in records
        if record.point.optimizer != "nadam"
        and (record.point.optimizer != "sgd" or record.point.schedule == "linear")
    ]
    part = effects.select_balanced_part(unfinished)
    assert part == [record for record in records if record.point.optimizer not in ("nadam", "sgd")]
    assert effects.has_enough_factors(part)
    assert not effects.has_enough_factors(effects.select_balanced_part(records[:7]))
    assert effects.select_balanced_part([*records, records[0]]) == records


def simulate_finalists(behind: float, seeds: int = 3) -> list[TrialRecord]:
    """Return ten finalists that differ by 3 % each, the last by `behind` from the one before it."""
    random = np.random.default_rng(1)
    numbers = [*range(100, 109), POINTS.index(OPTIMUM)]
    logs = [0.03 * place for place in range(9)] + [0.24 + behind]
    return [
        TrialRecord(
            number,
            POINTS[number],
            seed,
            20 * math.exp(log + 0.1 * seed + 0.01 * random.normal()),
            1.0,
            replicate=seed,
        )
        for number, log in zip(numbers, logs, strict=True)
        for seed in range(1, seeds + 1)
    ]


def test_significant_differences_between_finalists_are_found() -> None:
    finalists = ranking.compare_finalists(simulate_screening(), simulate_finalists(behind=0.5))
    assert [finalist.number for finalist in finalists] == [*range(100, 109), POINTS.index(OPTIMUM)]
    assert finalists[0].behind == 0 and finalists[1].low < 3.05 < finalists[1].high
    assert finalists[-1].low > 50
    assert finalists[-1].behind == pytest.approx(100 * (math.exp(0.74) - 1), rel=0.1)
    page = describe_finalists(finalists, 3)
    assert "is 10th of 10" in page and "significantly worse than the best: +" in page


def test_equal_finalists_are_rarely_significantly_different() -> None:
    """The best of thirty is so by chance: intervals without Tukey's correction fail in every fourth case."""
    screened, wrong = simulate_screening(), 0
    for seed in range(60):
        logs = np.random.default_rng(seed).normal(3.0, 0.1, (30, 3))
        records = [
            TrialRecord(n, POINTS[n], s, math.exp(logs[n, s]), 1.0, replicate=s)
            for n in range(30)
            for s in range(3)
        ]
        wrong += any(finalist.low > 0 for finalist in ranking.compare_finalists(screened, records)[1:])
    assert wrong <= 8


def test_a_finalist_with_another_seed_counts_and_one_without_a_replicate_is_left_out() -> None:
    screened, records = simulate_screening(), simulate_finalists(behind=0.5)
    diverged = [
        dataclasses.replace(record, seed=1001) if (record.number, record.seed) == (103, 1) else record
        for record in records
    ]
    assert ranking.compare_finalists(screened, diverged) == ranking.compare_finalists(screened, records)
    fewer = [record for record in records if (record.number, record.seed) != (103, 1)]
    finalists = ranking.compare_finalists(screened, fewer)
    assert len(finalists) == 9 and 103 not in {finalist.number for finalist in finalists}
    assert "1 point without a trial for every seed left out" in describe_finalists(finalists, 3, 1)
    assert ranking.compare_finalists(screened, []) == []


def test_the_best_finalist_is_not_compared_with_itself() -> None:
    finalists = ranking.compare_finalists(simulate_screening(), simulate_finalists(behind=-0.5))
    page = describe_finalists(finalists, 3)
    assert re.search(r"optimum is 1st of 10 with [\d.]+ %\.", page) and "| the best |" in page


def test_with_one_seed_no_difference_is_significant() -> None:
    finalists = ranking.compare_finalists(simulate_screening(), simulate_finalists(behind=0.5, seeds=1))
    assert all((finalist.low, finalist.high) == (-100, math.inf) for finalist in finalists)
    assert "not significantly worse than the best" in describe_finalists(finalists, 1)


def test_rank_correlations_have_intervals() -> None:
    random = np.random.default_rng(0)
    same = [RepeatedPoint(n, 50.0 + n, 20.0 + n) for n in range(30)]
    unrelated = [RepeatedPoint(n, 50.0 + n, float(random.uniform(20, 50))) for n in range(30)]
    for correlation in ranking.rank_correlations(same):
        assert correlation.value == pytest.approx(1) and correlation.low > 0.9
    for correlation in ranking.rank_correlations(unrelated):
        assert correlation.low < 0 < correlation.high
    # Resamples of one single point have no correlation.
    for correlation in ranking.rank_correlations(same[:2]):
        assert correlation.low == pytest.approx(1) and correlation.high == pytest.approx(1)


def test_opposite_ranks_are_described_as_such() -> None:
    opposite = [RepeatedPoint(n, 50.0 + n, 40.0 - n) for n in range(12)]
    assert "they rank in opposite order" in describe_repeats(opposite, 2)


def test_repeated_points_are_paired_with_the_screening() -> None:
    records = [TrialRecord(7, POINTS[7], seed, mre, 1.0) for seed, mre in ((1, 10.0), (2, 40.0))]
    screened = simulate_screening()
    (point,) = ranking.pair_with_screening(screened, records)
    assert (point.number, point.screened, point.mre) == (7, screened[7].mre, pytest.approx(20))
    assert ranking.pair_with_screening(screened[:7], records) == []
    page = describe_repeats([RepeatedPoint(n, 50.0 + n, 20.0 + n) for n in range(12)], 1)
    assert "12 points" in page and "with 1 seed each" in page and "budgets: 1.00 [1.00, 1.00]." in page


def test_the_optimum_is_ranked() -> None:
    records = simulate_screening()
    rank, count = ranking.rank_of_optimum(records)
    by_error = sorted(records, key=lambda record: record.mre)
    assert by_error[rank - 1].number == POINTS.index(OPTIMUM) and count == 1425


def test_random_search_quantiles_equal_those_over_all_orders() -> None:
    errors, quantiles = np.array([5.0, 1.0, 3.0, 2.0, 4.0]), (0.1, 0.5, 0.9)
    orders = [np.minimum.accumulate(order) for order in itertools.permutations(errors)]
    expected = np.quantile(orders, quantiles, axis=0, method="inverted_cdf")
    np.testing.assert_array_equal(search_cost.random_search_quantiles(errors, 5, quantiles), expected)


def test_a_search_is_replayed_on_the_grid() -> None:
    records = simulate_screening(sigma=0.01)
    lowest = search_cost.replay_tpe(records, 40, 2)
    assert lowest.shape == (2, 40) and (np.diff(lowest, axis=1) <= 0).all()
    assert {float(value) for value in lowest.ravel()} <= {record.mre for record in records}
    pruned = [TrialRecord(0, POINTS[0], 0, 30.0, 1.0), TrialRecord(1, POINTS[1], 0, 5.0, 1.0, pruned_at=10)]
    spent, running = search_cost.accumulate_lowest(pruned, steps=40)
    assert spent.tolist() == [40, 50] and running.tolist() == [30.0, 30.0]


def test_trials_are_read_as_they_were_written(tmp_path: Path) -> None:
    values = np.stack([np.linspace(20, 90, 1425), np.full(1425, 2.5)], axis=1)
    trials = write_finished_study(str(tmp_path / "study.db"), values).get_trials()
    assert trial_table.write_trials(tmp_path / "screening.csv", trials) == 1425
    records = trial_table.read_trials(tmp_path / "screening.csv")
    assert [(r.number, r.point, r.seed) for r in records] == [(n, p, 0) for n, p in enumerate(POINTS)]
    np.testing.assert_allclose([(r.mre, r.inference_ms) for r in records], values, atol=1e-5)
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="not a table of trials"):
        trial_table.read_trials(tmp_path / "other.csv")


def test_tables_charts_and_page_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(0)
    values = [(simulate_error(point, random), 2.0) for point in POINTS]
    queue = write_finished_study(str(tmp_path / "study.db"), np.array(values))
    queue.check_study_setting("budget", SCREENING.to_attributes())
    queue.measure_once("guess_mre", lambda: 50.0)
    out = tmp_path / "results"
    arguments = ["--storage", str(tmp_path / "study.db"), "--out", str(out), "--replays", "1"]
    command.main([*arguments, "--json", str(tmp_path / "figures.json")])
    page = (out / pipeline.PAGE).read_text()
    assert capsys.readouterr().out.strip() == page.strip()
    for text in (
        "- screening: 80 steps of 32",
        "1425 points, one seed",
        "| optimizer | sgd | +",
        "- optimizer — better: ",
        "; worse: sgd.",
        "The paper's optimum",
        "## Searching",
    ):
        assert text in page
    assert "missing" not in page
    below = sum(mre < 50 for mre, _ in values)
    assert f"an MRE of 50.0 %: {below} of 1425 are below" in page
    names = {path.name for path in out.iterdir()}
    assert names >= {"screening.csv", "main_effects.csv", "interactions.csv", "main_effects.png"}
    assert names >= {"parallel.png", "interactions.png", "spending.png"}
    for chart in (path for path in out.iterdir() if path.suffix == ".png"):
        assert f"({chart.name})" in page and chart.stat().st_size > 10_000
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert len(figures["main_effects"]) == 3 + 5 + 5 + 19 and figures["missing_points"] == 0


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (900, "estimated on 760 points with all combinations of their levels, without optimizer nadam."),
        (7, "Effects are not estimated"),
    ],
)
def test_what_there_is_of_an_unfinished_sweep_is_analysed(tmp_path: Path, count: int, expected: str) -> None:
    """Of 900 points all of large_imagenet are complete, and of small_imagenet all but some of nadam."""
    values = [(record.mre, 2.0) for record in simulate_screening()[:count]]
    write_finished_study(str(tmp_path / "study.db"), np.array(values))
    out = tmp_path / "results"
    command.main(["--storage", str(tmp_path / "study.db"), "--out", str(out)])
    page = (out / pipeline.PAGE).read_text()
    assert f"Unfinished: {1425 - count} of 1425 points are missing." in page and expected in page
    assert (out / "main_effects.png").exists() == ("estimated on" in expected)
    with (out / "screening.csv").open() as file:
        assert len(list(csv.DictReader(file))) == count


def written_figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return a list that collects the figures that the charts write."""
    figures: list[Figure] = []
    monkeypatch.setattr(charts, "write_figure", lambda path, figure: figures.append(figure))
    return figures


def test_numbers_of_points_do_not_overlap(monkeypatch: pytest.MonkeyPatch) -> None:
    figures, random = written_figures(monkeypatch), np.random.default_rng(0)
    points = [
        RepeatedPoint(n, float(60 + 5 * random.random()), float(40 + 8 * random.random())) for n in range(31)
    ]
    charts.plot_rank_agreement(Path("unused.png"), points)
    (axes,) = figures[0].axes
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) == 31
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


@pytest.mark.parametrize("has_optimum", [False, True])
def test_the_legend_names_the_optimum_only_if_it_is_there(
    monkeypatch: pytest.MonkeyPatch, has_optimum: bool
) -> None:
    figures = written_figures(monkeypatch)
    numbers = [100, 200, *([POINTS.index(OPTIMUM)] if has_optimum else [])]
    charts.plot_rank_agreement(Path("unused.png"), [RepeatedPoint(n, 50.0 + n, 20.0 + n) for n in numbers])
    charts.plot_parallel_coordinates(
        Path("unused.png"), [TrialRecord(n, POINTS[n], 0, 50.0 + n, 1.0) for n in numbers]
    )
    for legend in (figures[0].axes[0].get_legend(), figures[1].legends[0]):
        assert legend is not None
        assert ("the paper's optimum" in [text.get_text() for text in legend.get_texts()]) == has_optimum


def test_bad_input_is_refused(tmp_path: Path) -> None:
    storage = str(tmp_path / "study.db")
    with pytest.raises(InputError, match="name the --storage"):
        command.main(["--out", str(tmp_path)])
    with pytest.raises(InputError, match=r"no storage .*mistyped\.db"):
        command.main(["--out", str(tmp_path), "--storage", str(tmp_path / "mistyped.db")])
    StudyStorage(storage, RetryPolicy())
    with pytest.raises(InputError, match=r"no study other in .*there are: none"):
        command.main(["--out", str(tmp_path), "--storage", storage, "--screening", "other"])
