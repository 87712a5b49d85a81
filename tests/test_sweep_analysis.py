"""What is said of a sweep is what is in it."""

import dataclasses
import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from sweep_study import finished

from laesi_tf.common.errors import InputError
from sweeps.analysis import __main__, effects, findings, pipeline, ranking, search_cost, trial_table
from sweeps.analysis.trial_table import TrialRecord
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.trials.budget import SCREENING
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS, Point

CHANGES = {("start", "small_imagenet"): -0.2, ("optimizer", "sgd"): 0.5, ("schedule", "constant"): 0.1}
TOGETHER = {("start", "large_scratch", "optimizer", "sgd"): 0.4}


def error(point: Point, random: np.random.Generator, chance: float = 0.05) -> float:
    """An MRE of known effects on its logarithm, and some chance."""
    log = math.log(50.0) + chance * random.normal()
    log += sum(change for (factor, level), change in CHANGES.items() if point.levels[factor] == level)
    for (one, first, other, second), change in TOGETHER.items():
        log += change * (point.levels[one] == first and point.levels[other] == second)
    return math.exp(log)


def screening(chance: float = 0.05, seed: int = 0) -> list[TrialRecord]:
    random = np.random.default_rng(seed)
    return [TrialRecord(n, point, 0, error(point, random, chance), 1.0) for n, point in enumerate(POINTS)]


def test_effects_are_those_that_were_put_in() -> None:
    fitted = effects.estimate_effects(screening(chance=1e-6))
    found = {(effect.factor, effect.level): math.log1p(effect.change / 100) for effect in fitted.main}
    # Against the average over a factor's levels, the pair's own change spread over what it belongs to.
    small, pair = CHANGES["start", "small_imagenet"], TOGETHER["start", "large_scratch", "optimizer", "sgd"]
    assert found["start", "small_imagenet"] == pytest.approx(small - small / 3 - pair / 5 / 3, abs=1e-4)
    constant = CHANGES["schedule", "constant"]
    assert found["schedule", "constant"] == pytest.approx(constant * 4 / 5, abs=1e-4)
    assert all(
        found["augmentation", level] == pytest.approx(0, abs=1e-4) for level in FACTORS["augmentation"]
    )
    of_pair = next(e for e in fitted.pairs if e.level == "large_scratch x sgd")
    assert math.log1p(of_pair.change / 100) == pytest.approx(pair * (1 - 1 / 3) * (1 - 1 / 5), abs=1e-4)
    assert fitted.residual < 1e-6 and sum(fitted.shares.values()) + fitted.residual == pytest.approx(1)


def test_intervals_hold_what_they_promise() -> None:
    """No level of the augmentation does anything: of 95 % intervals over all 19 nearly all sets hold zero."""
    clean = [any(e.is_told_apart for e in _augmentations(seed)) for seed in range(20)]
    assert sum(clean) <= 4


def _augmentations(seed: int) -> list[effects.Effect]:
    return [e for e in effects.estimate_effects(screening(seed=seed)).main if e.factor == "augmentation"]


def test_interactions_worth_knowing_are_the_one_put_in() -> None:
    fitted = effects.estimate_effects(screening())
    assert findings.notable_interactions(fitted) == ["start x optimizer"]
    # What remains of a pair without any effect is what chance leaves it.
    shares = [fitted.shares["schedule x augmentation"], fitted.by_chance["schedule x augmentation"]]
    assert shares[0] == pytest.approx(shares[1], rel=0.5)
    said = findings.describe_screening(screening(), fitted)
    assert "- augmentation — no level can be told from the average." in said


def test_an_average_that_hides_more_than_it_says_is_called_so() -> None:
    """Scratch is better with sgd by much and worse with all others: on average it seems better."""

    def changed(row: TrialRecord) -> TrialRecord:
        cell = row.point.start == "large_scratch", row.point.optimizer == "sgd"
        return dataclasses.replace(row, mre=row.mre * {(True, True): 0.02, (True, False): 1.3}.get(cell, 1.0))

    rows = [changed(row) for row in screening()]
    page = "\n".join(findings.describe_screening(rows, effects.estimate_effects(rows)))
    assert re.search(r"- start — better: large_scratch.*hangs on the optimizer", page)
    assert "by start and optimizer" in page


def test_parts_of_the_grid_must_be_balanced() -> None:
    rows = screening()
    part = [row for row in rows if row.point.start == "large_scratch"]
    assert {effect.factor for effect in effects.estimate_effects(part).main} == {
        "optimizer",
        "schedule",
        "augmentation",
    }
    with pytest.raises(InputError, match="too few for intervals"):
        effects.estimate_effects([row for row in part if row.point.optimizer == "adam"])
    with pytest.raises(InputError, match="not all"):
        effects.estimate_effects(rows[:20])


def finalists(behind: float, seeds: int = 3) -> list[TrialRecord]:
    """Ten finalists that differ by 3 % each, the last by `behind` from the one before it."""
    random = np.random.default_rng(1)
    numbers = [*range(100, 109), POINTS.index(OPTIMUM)]
    logs = [0.03 * place for place in range(9)] + [0.24 + behind]
    return [
        TrialRecord(
            n, POINTS[n], seed, 20 * math.exp(log + 0.1 * seed + 0.01 * random.normal()), 1.0, replicate=seed
        )
        for n, log in zip(numbers, logs, strict=True)
        for seed in range(1, seeds + 1)
    ]


def test_finalists_are_told_apart_as_far_as_seeds_allow() -> None:
    found = ranking.compare_finalists(screening(), finalists(behind=0.5))
    assert [final.number for final in found] == [*range(100, 109), POINTS.index(OPTIMUM)]
    assert found[0].behind == 0 and found[1].low < 3.05 < found[1].high
    assert found[-1].low > 50 and found[-1].behind == pytest.approx(100 * (math.exp(0.74) - 1), rel=0.1)
    page = "\n".join(findings.describe_finalists(found, 3))
    assert "comes 10th of 10" in page and "is behind the best" in page


def test_finalists_that_are_alike_are_not_told_apart() -> None:
    """The best of thirty is so by luck: intervals against it alone tell some apart in every fourth case."""
    before, wrong = screening(), 0
    for seed in range(60):
        logs = np.random.default_rng(seed).normal(3.0, 0.1, (30, 3))
        rows = [
            TrialRecord(n, POINTS[n], s, math.exp(logs[n, s]), 1.0, replicate=s)
            for n in range(30)
            for s in range(3)
        ]
        wrong += any(final.low > 0 for final in ranking.compare_finalists(before, rows)[1:])
    assert wrong <= 8


def test_a_finalist_that_diverged_counts_and_one_that_lacks_a_seed_is_left_out() -> None:
    rows = finalists(behind=0.5)
    moved = [
        dataclasses.replace(row, seed=1001) if (row.number, row.seed) == (103, 1) else row for row in rows
    ]
    assert ranking.compare_finalists(screening(), moved) == ranking.compare_finalists(screening(), rows)
    fewer = [row for row in rows if (row.number, row.seed) != (103, 1)]
    found = ranking.compare_finalists(screening(), fewer)
    assert len(found) == 9 and 103 not in {final.number for final in found}
    assert "1 point not tried with every seed yet left out" in "\n".join(
        findings.describe_finalists(found, 3, 1)
    )
    assert ranking.compare_finalists(screening(), []) == []


def test_the_best_is_not_compared_with_itself() -> None:
    found = ranking.compare_finalists(screening(), finalists(behind=-0.5))
    page = "\n".join(findings.describe_finalists(found, 3))
    assert re.search(r"optimum comes 1st of 10 with [\d.]+ %\.", page) and "| the best |" in page


def test_ranks_in_opposite_order_are_called_so() -> None:
    opposite = [ranking.RepeatedPoint(n, 50.0 + n, 40.0 - n) for n in range(12)]
    assert "they rank in opposite order" in "\n".join(findings.describe_repeats(opposite, 2))


def test_one_seed_tells_no_finalists_apart() -> None:
    found = ranking.compare_finalists(screening(), finalists(behind=0.5, seeds=1))
    assert all((final.low, final.high) == (-100, math.inf) for final in found)
    assert "cannot be told from the best" in "\n".join(findings.describe_finalists(found, 1))


def test_ranks_agree_where_they_do() -> None:
    same = [ranking.Finalist(n, 50.0 + n, 20.0 + n, 0, 0, 0) for n in range(30)]
    random = np.random.default_rng(0)
    other = [ranking.Finalist(n, 50.0 + n, float(random.uniform(20, 50)), 0, 0, 0) for n in range(30)]
    for one in ranking.rank_correlations(same):
        assert one.value == pytest.approx(1) and one.low > 0.9
    for one in ranking.rank_correlations(other):
        assert one.low < 0 < one.high


def test_points_tried_again_are_paired_with_the_screening() -> None:
    rows = [TrialRecord(7, POINTS[7], seed, mre, 1.0) for seed, mre in ((1, 10.0), (2, 40.0))]
    screened = screening()
    (one,) = ranking.pair_with_screening(screened, rows)
    assert (one.number, one.screened, one.mre) == (7, screened[7].mre, pytest.approx(20))
    many = [ranking.RepeatedPoint(n, 50.0 + n, 20.0 + n) for n in range(12)]
    page = "\n".join(findings.describe_repeats(many, 1))
    assert "12 points" in page and "with 1 seed each" in page and "budgets: 1.00 [1.00, 1.00]." in page


def test_the_optimum_has_its_place() -> None:
    rows = screening()
    place, of = ranking.rank_of_optimum(rows)
    by_error = sorted(rows, key=lambda row: row.mre)
    assert by_error[place - 1].number == POINTS.index(OPTIMUM) and of == 1425


def test_the_best_of_random_orders_is_what_orders_give() -> None:
    errors = np.array([5.0, 1.0, 3.0, 2.0, 4.0])
    found = search_cost.random_search_quantiles(errors, 5, (0.1, 0.5, 0.9))
    orders = [np.minimum.accumulate(order) for order in itertools.permutations(errors)]
    for quantile, row in zip((0.1, 0.5, 0.9), found, strict=True):
        wanted = np.quantile(orders, quantile, axis=0, method="inverted_cdf")
        np.testing.assert_array_equal(row, wanted)


def test_a_search_is_replayed_on_the_grid() -> None:
    rows = screening(chance=0.01)
    found = search_cost.replay_tpe(rows, 40, 2)
    assert found.shape == (2, 40) and (np.diff(found, axis=1) <= 0).all()
    assert {float(value) for value in found.ravel()} <= {row.mre for row in rows}
    pruned = [TrialRecord(0, POINTS[0], 0, 30.0, 1.0), TrialRecord(1, POINTS[1], 0, 5.0, 1.0, pruned_at=10)]
    spent, lowest = search_cost.running_best(pruned, steps=40)
    assert spent.tolist() == [40, 50] and lowest.tolist() == [30.0, 30.0]


def test_tables_are_read_as_they_were_written(tmp_path: Path) -> None:
    values = np.stack([np.linspace(20, 90, 1425), np.full(1425, 2.5)], axis=1)
    trials = finished(str(tmp_path / "study.db"), values).trials()
    assert trial_table.write_trials(tmp_path / "screening.csv", trials) == 1425
    rows = trial_table.read_trials(tmp_path / "screening.csv")
    assert [(row.number, row.point, row.seed) for row in rows] == [(n, p, 0) for n, p in enumerate(POINTS)]
    np.testing.assert_allclose([(row.mre, row.inference_ms) for row in rows], values, atol=1e-5)
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="not a table of trials"):
        trial_table.read_trials(tmp_path / "other.csv")


def test_everything_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(0)
    values = [(error(point, random), 2.0) for point in POINTS]
    ledger = finished(str(tmp_path / "study.db"), np.array(values))
    ledger.agree("budget", SCREENING.told())
    ledger.once("guess_mre", lambda: 50.0)
    out = tmp_path / "results"
    arguments = ["--storage", str(tmp_path / "study.db"), "--out", str(out), "--replays", "1"]
    __main__.main([*arguments, "--json", str(tmp_path / "figures.json")])
    page = (out / pipeline.PAGE).read_text()
    assert capsys.readouterr().out.strip() == page.strip()
    for text in (
        "- screening: 80 steps of 32",
        "1425 points, one seed",
        "| optimizer | sgd | +",
        "- optimizer — better: ",
        "; worse: sgd.",
        "comes",
        "## Searching",
    ):
        assert text in page
    below = sum(mre < 50 for mre, _ in values)
    assert f"an MRE of 50.0 %: {below} of 1425 are below" in page
    names = {path.name for path in out.iterdir()}
    assert names >= {"screening.csv", "main_effects.csv", "interactions.csv", "main_effects.png"}
    assert names >= {"parallel.png", "interactions.png", "spending.png"}
    for picture in (path for path in out.iterdir() if path.suffix == ".png"):
        assert f"({picture.name})" in page and picture.stat().st_size > 10_000
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert len(figures["main_effects"]) == 3 + 5 + 5 + 19


def test_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name the --storage"):
        __main__.main(["--out", str(tmp_path)])
    with pytest.raises(InputError, match=r"no storage .*mistyped\.db"):
        __main__.main(["--out", str(tmp_path), "--storage", str(tmp_path / "mistyped.db")])
    StudyStorage(str(tmp_path / "study.db"), RetryPolicy())
    with pytest.raises(InputError, match=r"no study other in .*there are: none"):
        __main__.main(
            ["--out", str(tmp_path), "--storage", str(tmp_path / "study.db"), "--screening", "other"]
        )
