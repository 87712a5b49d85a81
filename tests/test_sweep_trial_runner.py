"""A trial on a shared compiled step equals one in a fresh process, and does not affect the next."""

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from sweep_trials import BUDGET, exact_outcome, make_discs, make_runner

from laesi_tf.common import metrics
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import CONFIG_FILE
from laesi_tf.data import synthetic
from laesi_tf.synthesis import Ranges, load_ranges
from laesi_tf.training import config_files, loop, validation
from laesi_tf.training.optimizers import OPTIMIZERS, make_optimizer, optimizer_variables
from laesi_tf.training.schedules import SCHEDULES, TableSchedule
from laesi_tf.training.trainer import TrainingDiverged
from sweeps.trials import training_data
from sweeps.trials.budget import Budget
from sweeps.trials.search_space import Point
from sweeps.trials.training_data import Batch, TrainingData
from sweeps.trials.trial_runner import TrialRunner

HERE = Path(__file__).parent
SCENES = HERE.parent / "sweeps" / "scenes"
NADAM = Point("small_imagenet", "nadam", "cosine", "all")
PLAIN = Point("small_imagenet", "nadam", "constant", "none")


pytestmark = pytest.mark.usefixtures("tiny_backbone")


@pytest.fixture(scope="module")
def shared(tiny_backbone: None) -> TrialRunner:
    return make_runner()


def run_exactly(runner: TrialRunner, point: Point, seed: int = 0) -> dict[str, object]:
    return exact_outcome(runner, point, runner.run(point, seed))


def test_a_shared_step_equals_a_fresh_process_to_the_last_bit(shared: TrialRunner) -> None:
    shared.run(PLAIN, 0)
    shared.run(Point("small_imagenet", "nadam", "linear", "paper"), 3)
    path = os.pathsep.join([str(HERE), str(HERE.parent)])
    threads = str(tf.config.threading.get_intra_op_parallelism_threads())
    command = [sys.executable, str(HERE / "sweep_trials.py"), ",".join(NADAM.levels.values()), threads]
    fresh = subprocess.run(
        command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=True
    )
    assert run_exactly(shared, NADAM) == json.loads(fresh.stdout)


def test_trials_do_not_depend_on_those_before(shared: TrialRunner) -> None:
    first = run_exactly(shared, NADAM)
    others = [
        run_exactly(shared, PLAIN),
        run_exactly(shared, NADAM, seed=1),
        run_exactly(shared, PLAIN, seed=1),
    ]
    assert run_exactly(shared, NADAM) == first
    assert len({other["mre"] for other in [first, *others]}) == 4
    assert run_exactly(shared, PLAIN) == others[0]


def test_a_diverged_trial_does_not_affect_the_next(
    shared: TrialRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = run_exactly(shared, PLAIN)
    clean = shared.data.iterate_batches

    def diverge_at_step_3(augmentations: tuple[str, ...], seed: int) -> Iterator[Batch]:
        for step, (images, target) in enumerate(clean(augmentations, seed)):
            yield images, target * (np.nan if step == 2 else 1.0)

    with monkeypatch.context() as patched:
        patched.setattr(shared.data, "iterate_batches", diverge_at_step_3)
        with pytest.raises(TrainingDiverged, match="nan at step 3"):
            shared.run(PLAIN, 0)
    assert run_exactly(shared, PLAIN) == before


def test_intermediate_reports_change_nothing(shared: TrialRunner) -> None:
    before = run_exactly(shared, PLAIN)
    reports: dict[int, float] = {}
    outcome = shared.run(PLAIN, 0, report_steps=(2, 4), on_report=reports.__setitem__)
    assert exact_outcome(shared, PLAIN, outcome) == before
    assert list(reports) == [2, 4] and reports[4] == outcome.mre != reports[2]

    def stop(step: int, mre: float) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        shared.run(PLAIN, 0, report_steps=(2,), on_report=stop)


def test_it_trains_as_fit_does(shared: TrialRunner, tmp_path: Path) -> None:
    """Both train on the same images and recalibrate batch normalisation on the same ones."""
    outcome, config = shared.run(NADAM, 0), BUDGET.config(NADAM, 0)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(validation, "_CALIBRATION_IMAGES", BUDGET.calibration)
        stream = list(shared.data.iterate_batches(NADAM.augmentations, 0))
        run = loop.fit(
            config,
            tmp_path,
            train=lambda start: stream,
            validation=shared.data.validation,
            show_progress=False,
        )
    # `fit` computes learning rates within the graph, which may round the last digit differently.
    assert run.metrics["mre"] == pytest.approx(outcome.mre, rel=1e-3)
    assert config_files.load_config(tmp_path / CONFIG_FILE) == config


def test_points_share_a_step_by_network_and_optimizer(shared: TrialRunner) -> None:
    keys = {point: shared.network_key(point) for point in (NADAM, PLAIN)}
    assert len(set(keys.values())) == 1
    large = [Point(start, "sgd", "linear", "none") for start in ("large_imagenet", "large_scratch")]
    assert shared.network_key(large[0]) == shared.network_key(large[1]) != shared.network_key(PLAIN)


def test_memory_is_flat_over_a_hundred_trials(shared: TrialRunner) -> None:
    def rss_mb() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    if not Path("/proc/self/statm").is_file():
        pytest.skip("needs /proc/self/statm of Linux")
    points = [Point("small_imagenet", "nadam", name, "paper") for name in SCHEDULES]
    memory_mb = []
    for trial in range(100):
        shared.run(points[trial % len(points)], 0)
        memory_mb.append(rss_mb())
    # A leak of one copy of the weights per trial would be four times as large; allocators vary by far less.
    weights_mb = 4e-6 * shared.network(PLAIN).count_params()
    assert np.median(memory_mb[-10:]) - np.median(memory_mb[20:30]) < 70 * weights_mb / 4


def test_an_epoch_has_every_image_once() -> None:
    data = TrainingData(BUDGET, threads=2, make_samples=make_discs)

    def stream(augmentations: tuple[str, ...], seed: int) -> np.ndarray:
        return np.concatenate([images for images, _ in data.iterate_batches(augmentations, seed)])

    first, repeated, other = stream((), 0), stream((), 0), stream((), 1)
    images = {image.tobytes() for image in data._images.numpy()}
    assert {image.tobytes() for image in first[:24]} == images == {image.tobytes() for image in other[:24]}
    np.testing.assert_array_equal(first, repeated)
    assert not np.array_equal(first, other)
    flipped = stream(("flip",), 0)
    mirrored = [np.array_equal(one, two[:, ::-1]) for one, two in zip(first, flipped, strict=True)]
    same = [np.array_equal(one, two) for one, two in zip(first, flipped, strict=True)]
    assert 3 < sum(mirrored) < 29 and sum(mirrored) + sum(same) == 32


def test_the_constant_guess_is_the_best_of_all(shared: TrialRunner) -> None:
    areas = np.concatenate([target[:, 0] for _, target in shared.data.validation])
    errors = [metrics.mre(np.full_like(areas, guess), areas) for guess in np.linspace(1, 60, 2000)]
    assert min(errors) * 0.995 < shared.data.constant_guess_mre() <= min(errors) + 1e-6


@pytest.mark.parametrize("schedule", list(SCHEDULES))
def test_a_table_of_learning_rates_equals_the_schedule(schedule: str) -> None:
    ends = {"peak": 1e-3, "final": 1e-9}
    table = TableSchedule(40)
    table.set_schedule(schedule, **ends)
    expected = make_optimizer("sgd", schedule=schedule, steps=40, **ends)._learning_rate
    for step in (0, 1, 20, 39, 40, 10**6):
        assert float(table(tf.constant(step))) == pytest.approx(float(expected(tf.constant(step))), rel=1e-6)


@pytest.mark.parametrize("name", list(OPTIMIZERS))
def test_the_optimizer_variables_are_all_that_a_step_changes(name: str) -> None:
    """Among all variables that can be found in an optimizer."""
    schedule = TableSchedule(3)
    schedule.set_schedule("constant", peak=1e-3, final=1e-3)
    optimizer = OPTIMIZERS[name](schedule)
    weights = [tf.keras.Variable([1.0, 2.0])]
    optimizer.build(weights)
    everything = [*optimizer.variables, *(v for v in vars(optimizer).values() if hasattr(v, "assign"))]
    before = {id(v): v.numpy().copy() for v in everything}
    optimizer.apply([tf.constant([0.1, 0.2])], weights)
    changed = {id(v) for v in everything if not np.array_equal(v.numpy(), before[id(v)])}
    assert changed <= {id(v) for v in optimizer_variables(optimizer)}


def test_invalid_budgets_are_refused() -> None:
    with pytest.raises(InputError, match="multiple of 64"):
        Budget(validation=100)
    with pytest.raises(InputError, match="at most the 64 images"):
        Budget(steps=2, calibration=256)
    with pytest.raises(InputError, match="no weights file"):
        Budget(weights_large="absent.weights.h5").to_attributes()


def test_budget_attributes_do_not_name_the_folder_of_weights(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "w.weights.h5").write_bytes(b"the same")
    one, other = (
        Budget(weights_large=str(tmp_path / folder / "w.weights.h5")).to_attributes()
        for folder in ("one", "other")
    )
    assert one == other and str(tmp_path) not in str(one)


def test_the_first_steps_may_see_silhouettes() -> None:
    budget = dataclasses.replace(BUDGET, silhouette_steps=1, calibration=16)

    def make_samples(budget: Budget, indices: Sequence[int]) -> Batch:
        images, targets = make_discs(budget, indices)
        return tf.concat([images, tf.cast(images[..., :1] > 128, tf.uint8) * 255], axis=-1), targets

    data = TrainingData(budget, threads=1, make_samples=make_samples)
    plain = TrainingData(BUDGET, threads=1, make_samples=make_discs)
    batches = [images.numpy() for images, _ in data.iterate_batches((), 0)]
    images = [images.numpy() for images, _ in plain.iterate_batches((), 0)]
    assert set(np.unique(batches[0])) == {0, 255}
    np.testing.assert_array_equal(batches[0], np.repeat(255 * (images[0][..., :1] > 128), 3, axis=-1))
    np.testing.assert_array_equal(batches[1:], images[1:])
    assert data.validation[0][0].shape == (64, 32, 32, 3)
    with pytest.raises(InputError, match="at most the 8 images of all steps after the silhouettes"):
        dataclasses.replace(BUDGET, silhouette_steps=3, calibration=16)


def test_trials_start_from_a_short_run_that_they_share(shared: TrialRunner) -> None:
    warm = make_runner(dataclasses.replace(BUDGET, warm_start_steps=6))
    first = run_exactly(warm, PLAIN)
    start = warm._initial_weights["small_imagenet", 0]
    assert run_exactly(warm, PLAIN) == first
    assert run_exactly(warm, PLAIN, seed=1) != first != run_exactly(shared, PLAIN)
    assert len(warm.run(PLAIN, 0).losses) == BUDGET.steps
    cold = shared._initial_weights["small_imagenet", 0]
    assert any(not np.array_equal(one, other) for one, other in zip(start, cold, strict=True))


def test_a_learning_rate_replaces_that_of_the_point(shared: TrialRunner) -> None:
    outcome = exact_outcome(shared, PLAIN, shared.run(PLAIN, 0))
    same = shared.run(PLAIN, 0, learning_rate=PLAIN.learning_rate)
    assert exact_outcome(shared, PLAIN, same) == outcome
    other = shared.run(PLAIN, 0, learning_rate=PLAIN.learning_rate / 10)
    assert exact_outcome(shared, PLAIN, other) != outcome


def test_scenes_are_those_of_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    budgets = [Budget(size=32, ranges="phone"), Budget(size=32, ranges="phone", silhouette_steps=40)]
    mask = tf.constant([[0, 1], [1, 1]], tf.uint8)
    sample = {"image": tf.fill([2, 2, 3], tf.constant(9, tf.uint8)), "mask": mask}
    sample |= {"area_cm2": tf.constant(5.0), "px_per_mm": tf.constant(2.0)}

    def make_samples(leaves: tf.data.Dataset, *, ranges: Ranges, **_: object) -> tf.data.Dataset:
        # The area of an empty sheet is 0, to which no error is relative.
        assert ranges == load_ranges("phone").without_empty_sheets()
        return leaves.map(lambda leaf: sample)

    monkeypatch.setattr(synthetic, "samples_of_leaves", make_samples)
    (plain, _), (images, _) = (training_data.render_scenes(budget, [0, 1]) for budget in budgets)
    assert plain.shape == (2, 2, 2, 3)
    np.testing.assert_array_equal(images[..., :3], plain)
    np.testing.assert_array_equal(images[0, ..., 3], 255 * mask.numpy())


def test_files_of_ranges_are_described_by_their_content(tmp_path: Path) -> None:
    path = tmp_path / "scenes.toml"
    with pytest.raises(InputError, match=r"no file of ranges .*scenes\.toml"):
        Budget(ranges=str(path)).to_attributes()
    path.write_text('base = "phone"\n')
    described = Budget(ranges=str(path)).to_attributes()["ranges"]
    assert described.startswith("scenes.toml, sha256 ") and str(tmp_path) not in described
    assert Budget(ranges="phone").to_attributes()["ranges"] == "phone"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_scenes_of_the_screening_can_be_rendered(path: Path) -> None:
    ranges = load_ranges(path)
    assert set(ranges.leaf) == set(load_ranges("rendering_2").leaf)
    longest = max(leaf.length_mm[1] for _, leaf in ranges.leaf.values())
    # A whole leaf fits into the widest view, so that the scale of a fixed view is never reduced.
    assert longest < 0.9 * ranges.camera.farthest_mm
