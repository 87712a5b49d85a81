"""Trials on a shared compiled step are those of fresh processes, and leave nothing behind."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from sweep_trial import BUDGET, made, told, trainer

from laesi_tf.common import metrics
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import CONFIG_FILE
from laesi_tf.training import config_files, loop
from laesi_tf.training.optimizers import OPTIMIZERS, make_optimizer, optimizer_variables
from laesi_tf.training.schedules import SCHEDULES, TableSchedule
from laesi_tf.training.trainer import TrainingDiverged
from sweeps.trials.budget import Budget
from sweeps.trials.search_space import Point
from sweeps.trials.training_data import TrainingData
from sweeps.trials.trial_runner import TrialRunner

HERE = Path(__file__).parent
NADAM = Point("small_imagenet", "nadam", "cosine", "all")
PLAIN = Point("small_imagenet", "nadam", "constant", "none")


@pytest.fixture(scope="module")
def shared() -> TrialRunner:
    return trainer()


def result(trained: TrialRunner, point: Point, seed: int = 0) -> dict[str, object]:
    return told(trained, point, trained.run(point, seed))


def test_a_shared_step_gives_what_a_fresh_process_gives_to_the_last_bit(shared: TrialRunner) -> None:
    shared.run(PLAIN, 0)
    shared.run(Point("small_imagenet", "nadam", "linear", "paper"), 3)
    path = os.pathsep.join([str(HERE), str(HERE.parent)])
    threads = str(tf.config.threading.get_intra_op_parallelism_threads())
    command = [sys.executable, str(HERE / "sweep_trial.py"), ",".join(NADAM.levels.values()), threads]
    fresh = subprocess.run(
        command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=True
    )
    assert result(shared, NADAM) == json.loads(fresh.stdout)


def test_trials_do_not_depend_on_those_before(shared: TrialRunner) -> None:
    first = result(shared, NADAM)
    others = [result(shared, PLAIN), result(shared, NADAM, seed=1), result(shared, PLAIN, seed=1)]
    assert result(shared, NADAM) == first
    assert len({other["mre"] for other in [first, *others]}) == 4
    assert result(shared, PLAIN) == others[0]


def test_a_trial_that_diverged_leaves_nothing_behind(
    shared: TrialRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = result(shared, PLAIN)
    clean = shared.pictures.training

    def poisoned(*arguments):  # type: ignore[no-untyped-def]
        for step, (images, target) in enumerate(clean(*arguments)):
            yield images, target * (np.nan if step == 2 else 1.0)

    with monkeypatch.context() as patched:
        patched.setattr(shared.pictures, "training", poisoned)
        with pytest.raises(TrainingDiverged, match="nan at step 3"):
            shared.run(PLAIN, 0)
    assert result(shared, PLAIN) == before


def test_rungs_tell_how_far_it_is_and_change_nothing(shared: TrialRunner) -> None:
    before, reached = result(shared, PLAIN), {}
    outcome = shared.run(PLAIN, 0, rungs=(2, 4), reached=lambda step, mre: reached.update({step: mre}))
    assert told(shared, PLAIN, outcome) == before
    assert list(reached) == [2, 4] and reached[4] == outcome.mre != reached[2]

    def enough(step: int, mre: float) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        shared.run(PLAIN, 0, rungs=(2,), reached=enough)


def test_it_trains_as_fit_does(shared: TrialRunner, tmp_path: Path) -> None:
    """On the same pictures; batch normalisation is then recalibrated on the same as well."""
    outcome, config = shared.run(NADAM, 0), BUDGET.config(NADAM, 0)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(loop, "_CALIBRATION_PICTURES", BUDGET.calibration)
        stream = list(shared.pictures.training(NADAM.augmentations, 0))
        run = loop.fit(
            config, tmp_path, train=lambda start: stream, validation=shared.pictures.validation, show_progress=False
        )
    # fit works its rates out within the graph, which may round otherwise in the last place.
    assert run.metrics["mre"] == pytest.approx(outcome.mre, rel=1e-3)
    assert config_files.load_config(tmp_path / CONFIG_FILE) == config


def test_points_share_a_step_by_network_and_optimizer(shared: TrialRunner) -> None:
    keys = {point: shared.key(point) for point in (NADAM, PLAIN)}
    assert len(set(keys.values())) == 1
    large = [Point(start, "sgd", "linear", "none") for start in ("large_imagenet", "large_scratch")]
    assert shared.key(large[0]) == shared.key(large[1]) != shared.key(PLAIN)


def test_memory_is_flat_over_a_hundred_trials(shared: TrialRunner) -> None:
    def rss_mb() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    if not Path("/proc/self/statm").is_file():
        pytest.skip("needs Linux's own account of memory")
    points = [Point("small_imagenet", "nadam", name, "paper") for name in SCHEDULES]
    held = []
    for trial in range(100):
        shared.run(points[trial % len(points)], 0)
        held.append(rss_mb())
    # What a leak of one copy of the weights per trial would take: far above what allocators do.
    weights_mb = 4e-6 * shared.model(PLAIN).count_params()
    assert np.median(held[-10:]) - np.median(held[20:30]) < 70 * weights_mb / 4


def test_each_picture_comes_once_before_any_comes_again() -> None:
    pictures = TrainingData(BUDGET, threads=2, made=made)
    stream = np.concatenate([images for images, _ in pictures.training((), 0)])
    again = np.concatenate([images for images, _ in pictures.training((), 0)])
    other = np.concatenate([images for images, _ in pictures.training((), 1)])
    kept = {image.tobytes() for image in pictures._images.numpy()}
    assert {image.tobytes() for image in stream[:24]} == kept == {image.tobytes() for image in other[:24]}
    np.testing.assert_array_equal(stream, again)
    assert not np.array_equal(stream, other)
    flipped = np.concatenate([images for images, _ in pictures.training(("flip",), 0)])
    mirrored = [np.array_equal(one, two[:, ::-1]) for one, two in zip(stream, flipped, strict=True)]
    same = [np.array_equal(one, two) for one, two in zip(stream, flipped, strict=True)]
    assert 3 < sum(mirrored) < 29 and sum(mirrored) + sum(same) == 32


def test_the_best_guess_is_the_best_of_all_guesses(shared: TrialRunner) -> None:
    areas = np.concatenate([target[:, 0] for _, target in shared.pictures.validation])
    tried = [metrics.mre(np.full_like(areas, guess), areas) for guess in np.linspace(1, 60, 2000)]
    assert min(tried) * 0.995 < shared.pictures.guess_mre() <= min(tried) + 1e-6


@pytest.mark.parametrize("schedule", list(SCHEDULES))
def test_a_table_of_rates_is_the_schedule(schedule: str) -> None:
    ends = {"peak": 1e-3, "final": 1e-9}
    table = TableSchedule(40)
    table.follow(schedule, **ends)
    wanted = make_optimizer("sgd", schedule=schedule, steps=40, **ends)._learning_rate
    for step in (0, 1, 20, 39, 40, 10**6):
        assert float(table(tf.constant(step))) == pytest.approx(float(wanted(tf.constant(step))), rel=1e-6)


@pytest.mark.parametrize("name", list(OPTIMIZERS))
def test_an_optimizers_state_is_all_that_a_step_changes(name: str) -> None:
    """Of everything an optimizer holds, found by looking through it."""
    rates = TableSchedule(3)
    rates.follow("constant", peak=1e-3, final=1e-3)
    made_one = OPTIMIZERS[name](rates)
    weights = [tf.keras.Variable([1.0, 2.0])]
    made_one.build(weights)
    everything = [*made_one.variables, *(v for v in vars(made_one).values() if hasattr(v, "assign"))]
    before = {id(v): v.numpy().copy() for v in everything}
    made_one.apply([tf.constant([0.1, 0.2])], weights)
    changed = {id(v) for v in everything if not np.array_equal(v.numpy(), before[id(v)])}
    assert changed <= {id(v) for v in optimizer_variables(made_one)}


def test_budgets_that_do_not_fit() -> None:
    with pytest.raises(InputError, match="multiple of 64"):
        Budget(validation=100)
    with pytest.raises(InputError, match="more than the 64 trained on"):
        Budget(steps=2, calibration=256)
    with pytest.raises(InputError, match="no weights file"):
        Budget(weights_large="absent.weights.h5").told()


def test_where_weights_lie_is_not_told(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "w.weights.h5").write_bytes(b"the same")
    told_of = [Budget(weights_large=str(tmp_path / f / "w.weights.h5")).told() for f in ("one", "other")]
    assert told_of[0] == told_of[1] and str(tmp_path) not in str(told_of)
