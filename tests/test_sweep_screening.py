"""The choice of the screening: its points, candidates, agreement and report."""

import csv
import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from laesi_tf.common.errors import InputError
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.screening import __main__ as screening
from sweeps.screening import agreement, report
from sweeps.screening.candidates import CANDIDATES, REFERENCE, adapt_candidate, spread_points
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS
from sweeps.workers.worker_settings import WorkerSettings

COUNT = 6
NOISE = {"fixed_scale": 0.0, "as_before": 3.0}
"""How far the errors of a stand-in for training are from those of the reference; others are by 1."""


def train_stand_in(settings: WorkerSettings, queue: GridQueue, *_: Any, **__: Any) -> None:
    """Complete all waiting trials with errors that agree with the reference as NOISE says."""
    name = settings.study.removeprefix("screening-")
    queue.measure_once("guess_mre", lambda: 60.0)
    noise = 0.0 if name == "reference" else NOISE.get(name, 1.0)
    while claim := queue.claim():
        number = int(claim.job.name[:4])
        error = 120.0 + number / 20 + noise * 30 * np.sin(7 * number)
        cost = {"steps_cpu_s": 20.0 if name == "large_batches" else 7.0, "judging_s": 0.5}
        queue.finish(claim, [error, 1.0], cost)


def run(folder: Path, *more: str) -> dict[str, Any]:
    """Run the command on few points with its tables in `folder`; return its figures."""
    arguments = ["--storage", str(folder / "study.db"), "--out", str(folder), "--points", str(COUNT)]
    screening.main([*arguments, "--weights-large", "none", "--weights-small", "none", *more])
    figures: dict[str, Any] = json.loads((folder / report.FIGURES).read_text())
    return figures


def test_the_points_are_spread_evenly_over_all_factors() -> None:
    numbers = spread_points(24)
    assert len(set(numbers)) == 24 and numbers == spread_points(24) == sorted(numbers)
    assert POINTS.index(OPTIMUM) in numbers
    points = [POINTS[number] for number in numbers]
    for factor, levels in FACTORS.items():
        counts = Counter(point.levels[factor] for point in points)
        assert set(counts) == set(levels) and max(counts.values()) - min(counts.values()) <= 1
    # No two are alike in more than what 24 points on fewer pairs of levels must share.
    pairs = Counter((point.start, point.optimizer) for point in points)
    assert set(pairs.values()) == {1, 2} and len(pairs) == 15


def test_candidates_have_the_networks_and_scenes_of_the_reference() -> None:
    reference = screening.budget_from_args(
        screening._make_parser().parse_args(["--ranges", "phone", "--weights-small", "none"]), REFERENCE
    )
    adapted = {name: adapt_candidate(budget, reference) for name, budget in CANDIDATES.items()}
    assert all(budget.weights_small == "none" for budget in adapted.values())
    assert adapted["as_before"].ranges == "phone"
    assert adapted["fixed_scale"].ranges.endswith("fixed_scale.toml")
    assert len({str(budget) for budget in adapted.values()}) == len(CANDIDATES)


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), min_size=4, max_size=12))
def test_tau_equals_that_of_scipy(values: list[tuple[int, int]]) -> None:
    pairs = np.array(values, float)
    expected = stats.kendalltau(*pairs.T).statistic
    signs = np.sign(pairs[:, None] - pairs[None])
    assert agreement._tau_of_signs(signs) == pytest.approx(expected, nan_ok=True)


def test_intervals_are_those_of_a_bootstrap_over_points() -> None:
    generator = np.random.default_rng(0)
    first = generator.normal(size=24)
    tau = agreement.kendall_tau(np.stack([first, first + generator.normal(size=24)], axis=1))
    assert tau.low < tau.value < tau.high and 0.2 < tau.high - tau.low < 0.8
    perfect = agreement.kendall_tau(np.stack([first, np.exp(first)], axis=1))
    assert (perfect.value, perfect.low, perfect.high) == pytest.approx((1.0, 1.0, 1.0))
    assert str(agreement.kendall_tau(np.ones((3, 2)))) == "too few points"


def test_the_better_half_is_that_of_the_reference() -> None:
    reference = {number: 10.0 + number for number in range(8)}
    # The better four in the opposite order, the others right, and all behind them.
    candidate = {number: (4.0 - number if number < 4 else 10.0 + number) for number in range(8)}
    found = agreement.measure_agreement(reference, candidate | {99: 1.0})
    assert found.better_half.value == -1.0 and found.better_half.points == 4
    assert found.all_points.value == pytest.approx((28 - 12) / 28)


def test_close_points_are_told_from_those_far_apart() -> None:
    reference = {0: 10.0, 1: 10.5, 2: 20.0}
    assert agreement.share_of_ordered_pairs(reference, {0: 2.0, 1: 1.0, 2: 3.0}) == [
        ("0 to 10 %", 1, 0.0),
        ("over 30 %", 2, 1.0),
    ]


def test_a_level_that_is_ranked_worse_has_a_positive_shift() -> None:
    numbers = spread_points(24)
    reference = {number: 10.0 + number for number in numbers}
    candidate = {n: mre + 5000 * (POINTS[n].optimizer == "sgd") for n, mre in reference.items()}
    shifts = {level: shift for _, level, shift, _ in agreement.rank_shifts(reference, candidate)}
    assert shifts["sgd"] > 3 and shifts["adam"] < 0


def test_it_chooses_the_candidate_that_ranks_as_the_reference_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(screening, "run_study", train_stand_in)
    names = ["fixed_scale", "as_before", "large_batches"]
    assert run(tmp_path, "--only", *names)["best"] == ""
    assert "no complete trial yet" in capsys.readouterr().out
    figures = run(tmp_path, "--only", "reference", "--reference-seeds", "2")
    assert figures["best"] == "fixed_scale" and set(figures["candidates"]) == set(names)
    assert figures["candidates"]["fixed_scale"]["all_points"]["value"] == pytest.approx(1.0)
    assert figures["candidates"]["large_batches"]["cost_s"] == 20.5
    assert figures["repeatability"][0]["value"] == pytest.approx(1.0)
    page = capsys.readouterr().out
    assert "times as much as as_before: fixed_scale, tau 1.00 over 6 points (reaches the aim of 0.6)" in page
    with (tmp_path / report.TABLE).open() as file:
        rows = {row["candidate"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["as_before", "fixed_scale", "large_batches"]
    assert rows["fixed_scale"]["scenes"] == "fixed_scale.toml" and rows["fixed_scale"]["points"] == "6"
    with (tmp_path / report.POINTS_TABLE).open() as file:
        points = list(csv.DictReader(file))
    assert len(points) == COUNT and all(float(row["reference"]) > 0 for row in points)
    assert figures == run(tmp_path, "--report")


def test_points_that_are_given_up_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail_the_optimum(settings: WorkerSettings, queue: GridQueue, *_: Any, **__: Any) -> None:
        while claim := queue.claim():
            if claim.job.name.startswith(f"{POINTS.index(OPTIMUM):04d}"):
                queue.fail(claim, "training diverged")
            else:
                queue.finish(claim, [50.0 + claim.trial_id, 1.0], {"steps_cpu_s": 1.0, "judging_s": 0.0})

    monkeypatch.setattr(screening, "run_study", fail_the_optimum)
    figures = run(tmp_path, "--only", "fixed_scale")
    assert len(figures["candidates"]["fixed_scale"]["errors"]) == COUNT - 1
    diverged = "; ".join(["training diverged"] * 4)
    assert f"given up, and left out: fixed_scale 0002: {diverged}" in capsys.readouterr().out


def test_a_killed_run_continues(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def train_two(settings: WorkerSettings, queue: GridQueue, *_: Any, **__: Any) -> None:
        claims = [queue.claim() for _ in range(2)]
        for claim in filter(None, claims):
            queue.finish(claim, [50.0, 1.0], {"steps_cpu_s": 1.0, "judging_s": 0.0})
        raise KeyboardInterrupt

    monkeypatch.setattr(screening, "run_study", train_two)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path, "--only", "reference")
    monkeypatch.setattr(screening, "run_study", train_stand_in)
    run(tmp_path, "--only", "reference")
    storage = StudyStorage(str(tmp_path / "study.db"), RetryPolicy())
    queue = GridQueue(storage, "screening-reference", FACTORS)
    complete = [trial.values[0] for trial in queue.get_trials()]
    assert len(complete) == COUNT and complete.count(50.0) == 4
    with pytest.raises(InputError, match="size is 128 there and 96 here"):
        run(tmp_path, "--only", "reference", "--size", "96")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "largest"], "invalid choice"),
        (["--report"], r"no storage .*study\.db"),
        (["--points", "0"], "from 1 up"),
        (["--ranges", "absent.toml"], r"no file of ranges absent\.toml"),
        (["--validation", "100"], "multiple of 64"),
        (["--time-limit", "-1"], "above 0"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(
    tmp_path: Path, arguments: Iterable[str], message: str
) -> None:
    with pytest.raises(InputError, match=message) as raised:
        run(tmp_path, *arguments)
    assert "\n" not in str(raised.value) and not list(tmp_path.iterdir())
