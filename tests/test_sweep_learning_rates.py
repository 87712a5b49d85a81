"""The test of learning rates: which rate it finds, and that it continues."""

import csv
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from laesi_tf.common.errors import InputError
from laesi_tf.training.trainer import TrainingDiverged
from sweeps import learning_rates
from sweeps.learning_rates import RateTrial, best_rates, median_ratios
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.trial_queue import ClaimedTrial, Job
from sweeps.trials.search_space import FACTORS, OPTIMUM, STARTS
from sweeps.workers.watchdog import TrialWatchdog


def make_trials(errors: dict[float, list[float]], optimizer: str = "adam") -> list[RateTrial]:
    return [
        RateTrial(optimizer, rate, STARTS[index % 3], index // 3, mre)
        for rate, values in errors.items()
        for index, mre in enumerate(values)
    ]


def test_the_best_rate_is_the_lowest_whose_median_is_near_the_best() -> None:
    # The second start is twice as hard and the third diverges at the best rate; medians of the MRE itself
    # would be those of the second alone.
    others = [90.0, 180.0, 90.0]
    errors = dict.fromkeys(map(float, learning_rates._ADAPTIVE), others)
    errors |= {1e-3: [31.0, 61.0, 1e6], 3e-3: [30.0, 62.0, 1e6], 1e-2: [60.0, 60.0, 50.0]}
    trials = make_trials(errors)
    assert median_ratios(trials)["adam"][1e-3] == pytest.approx(31 / 30)
    assert best_rates(trials) == {"adam": 1e-3}
    # A start without all rates does not count: its lowest may be at one that is missing.
    unfinished = RateTrial("adam", 1e-2, STARTS[0], 7, 1.0)
    assert best_rates([*trials, unfinished]) == {"adam": 1e-3}
    assert best_rates([unfinished]) == {}


@given(st.lists(st.lists(st.floats(1.0, 1e6), min_size=6, max_size=6), min_size=1, max_size=6), st.randoms())
def test_the_best_rate_depends_on_neither_order_nor_scale(errors: list[list[float]], random: Any) -> None:
    rates = [float(rate) for rate in learning_rates._ADAPTIVE]
    trials = make_trials(dict(zip(rates, zip(*errors, strict=True), strict=True)))  # type: ignore[arg-type]
    best = best_rates(trials)["adam"]
    ratios = median_ratios(trials)["adam"]
    assert best == min(rate for rate in rates if ratios[rate] <= 1.1 * min(ratios.values()))
    scaled = [dataclasses.replace(t, mre=t.mre * (1 + STARTS.index(t.start))) for t in trials]
    random.shuffle(scaled)
    assert median_ratios(scaled)["adam"] == pytest.approx(ratios)


def test_every_rate_is_tried_from_every_start_and_seed() -> None:
    jobs = learning_rates._make_jobs(2)
    assert len({job.name for job in jobs}) == len(jobs) == 2 * 3 * (4 * 6 + 7)
    assert sorted(job.name for job in jobs)[0].startswith("0 ")
    points = [learning_rates._point(job) for job in jobs]
    assert {point.optimizer for point in points} == set(FACTORS["optimizer"])
    assert {(point.schedule, point.augmentation) for point in points} == {(OPTIMUM.schedule, "none")}


def test_finished_trials_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    storage = str(tmp_path / "study.db")
    queue = GridQueue(StudyStorage(storage, RetryPolicy()), "learning_rates", learning_rates._FACTORS)
    budget = learning_rates.SCREENING.to_attributes()
    del budget["learning_rates"]
    queue.check_study_setting("budget", budget)
    # Those of two optimizers are enough: the others are missing, as in an unfinished study.
    names = {"adam": 1e-3, "sgd": 0.1}
    queue.enqueue([job for job in learning_rates._make_jobs(1) if job.levels["optimizer"] in names])
    while claim := queue.claim():
        levels = claim.job.levels
        distance = abs(np.log10(float(levels["rate"]) / names[levels["optimizer"]]))
        queue.finish(claim, [30.0 + 10 * distance, 0.0], {})
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(learning_rates, "_make_jobs", lambda seeds: [])
        files = ["--out", str(tmp_path / "trials.csv"), "--json", str(tmp_path / "rates.json")]
        learning_rates.main(["--storage", storage, *files])
    assert "adam: 0.001\nsgd: 0.1" in capsys.readouterr().out
    assert json.loads((tmp_path / "rates.json").read_text())["best"] == names
    with (tmp_path / "trials.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 3 * (6 + 7)
    with pytest.raises(InputError, match="steps is 80 there and 90 here"):
        learning_rates.main(["--storage", storage, "--steps", "90"])


def test_a_trial_that_diverges_is_a_result(tmp_path: Path) -> None:
    class Runner:
        def prepare(self, *_: Any) -> None:
            pass

        def run(self, *_: Any, learning_rate: float, **__: Any) -> None:
            assert learning_rate == 0.3
            raise TrainingDiverged("training diverged")

    queue = GridQueue(StudyStorage(str(tmp_path / "s.db"), RetryPolicy()), "s", learning_rates._FACTORS)
    claim = ClaimedTrial(0, 0, Job("0", {"start": STARTS[0], "optimizer": "sgd", "rate": "0.3"}, 0))
    result = learning_rates._try_rate(Runner(), claim, TrialWatchdog(queue))  # type: ignore[arg-type]
    assert result.values[0] == learning_rates._DIVERGED_MRE


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "0"], "from 1 up"),
        (["--ranges", "absent.toml"], r"no file of ranges absent\.toml"),
        (["--weights-small", "absent.h5"], "no weights file"),
        (["--out", "."], "is a folder"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(
    tmp_path: Path, arguments: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        learning_rates.main(["--storage", str(tmp_path / "study.db"), *arguments])
    assert not list(tmp_path.iterdir())
