"""What is stored of a trial: values, attributes, artifacts, the best networks."""

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from optuna.trial import TrialState
from sweep_trials import BUDGET, make_runner

from laesi_tf.common.run_files import CONFIG_FILE
from laesi_tf.models.area_network import SMALLEST_CM2
from laesi_tf.models.saved_model import load_run
from laesi_tf.training.config_files import load_config
from sweeps import benchmark
from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.tpe_queue import PRUNED_AT, TpeQueue
from sweeps.queue.trial_queue import ClaimedTrial
from sweeps.trials import artifacts, trial_runner
from sweeps.trials.search_space import FACTORS, POINTS, Point
from sweeps.trials.training_data import Batch
from sweeps.trials.trial_runner import TrialRunner
from sweeps.workers.objective import TrainingObjective
from sweeps.workers.watchdog import TrialWatchdog
from sweeps.workers.worker import TrialResult, run_trials

# One network and optimizer, so that one compiled step is enough.
NUMBERS = [n for n, p in enumerate(POINTS) if (p.start, p.optimizer) == ("small_imagenet", "sgd")][:4]
SEARCHED = FACTORS | {"start": ("small_imagenet",), "optimizer": ("sgd",)}


pytestmark = pytest.mark.usefixtures("tiny_backbone")


@pytest.fixture(scope="module")
def shared(tiny_backbone: None) -> TrialRunner:
    return make_runner()


def open_storage(folder: Path) -> StudyStorage:
    return StudyStorage(str(folder / "study.db"), RetryPolicy())


def test_trials_are_stored_with_what_the_dashboard_shows(shared: TrialRunner, tmp_path: Path) -> None:
    queue = GridQueue(open_storage(tmp_path), "grid", FACTORS)
    queue.enqueue(job_selection.select_points(NUMBERS))
    run_trials(queue, TrainingObjective(shared, queue, tmp_path))
    trials = [history.complete for history in queue.job_histories().values() if history.complete]
    assert len(trials) == len(NUMBERS)
    attributes = {"images_per_s", "parameters", "inference_ms", "checkpoint", "seed", "median", "worker"}
    best = float("inf")
    for trial in trials:
        assert set(trial.user_attrs) > attributes
        assert trial.values[1] == trial.user_attrs["inference_ms"] == trials[0].values[1] > 0
        files = [json.loads(text) for key, text in trial.system_attrs.items() if "artifacts:" in key]
        assert sorted(file["filename"] for file in files) == ["loss.png", "worst.jpg"]
        for file in files:
            data = np.fromfile(tmp_path / "artifacts" / file["artifact_id"], np.uint8)
            image = cv2.imdecode(data, cv2.IMREAD_COLOR)
            assert image is not None and image.shape[1] > 300
        assert bool(trial.user_attrs["checkpoint"]) == (trial.values[0] < best)
        best = min(best, trial.values[0])
    best_trial = next(trial for trial in trials if trial.values[0] == best)
    run = load_run(tmp_path / "checkpoints" / best_trial.user_attrs["checkpoint"])
    assert load_config(run.path / CONFIG_FILE) == BUDGET.config(Point(**best_trial.params), 0)
    images = shared.data.validation[0][0]
    repeated = shared.run(Point(**best_trial.params), 0)
    # No predicted area is below this, whatever a few steps at the rate of SGD have taught.
    predicted = np.maximum(np.exp(run.model(images, training=False).numpy()[:, 0]), SMALLEST_CM2)
    np.testing.assert_allclose(predicted, repeated.results["predicted"], rtol=1e-4)


def test_a_divergence_is_recorded_and_retried_with_another_seed(
    shared: TrialRunner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue = GridQueue(open_storage(tmp_path), "grid", FACTORS)
    queue.enqueue(job_selection.select_points(NUMBERS[:1]))
    clean, seeds = shared.data.iterate_batches, []

    def diverge_with_seed_0(augmentations: tuple[str, ...], seed: int) -> Iterator[Batch]:
        seeds.append(seed)
        for images, target in clean(augmentations, seed):
            yield images, target * (np.nan if seed == 0 else 1.0)

    shared.prepare(POINTS[NUMBERS[0]], 0)
    monkeypatch.setattr(shared.data, "iterate_batches", diverge_with_seed_0)
    run_trials(queue, TrainingObjective(shared, queue, tmp_path))
    (history,) = queue.job_histories().values()
    assert [trial.user_attrs["reason"] for trial in history.failed] == [
        "training diverged: the loss is nan at step 1"
    ]
    assert history.complete is not None and history.complete.user_attrs["seed"] == 1000
    assert seeds == [0, 1000] and history.job.seed == 0


def test_a_search_trains_the_same_points_and_prunes(shared: TrialRunner, tmp_path: Path) -> None:
    queue = TpeQueue(open_storage(tmp_path), "tpe", SEARCHED, trials=16, seed=0)
    run_trials(queue, TrainingObjective(shared, queue, tmp_path))
    complete = [trial for trial in queue.get_trials() if trial.state is TrialState.COMPLETE]
    pruned = [trial for trial in queue.get_trials() if trial.state is TrialState.PRUNED]
    assert len(complete) + len(pruned) == 16 and pruned
    assert {trial.user_attrs[PRUNED_AT] for trial in pruned} <= {1, 2}
    assert shared.run(Point(**complete[0].params), 0).mre == complete[0].values[0]


def test_the_benchmark_counts_a_retried_trial_once(
    shared: TrialRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts, train = [], TrainingObjective.__call__

    def fail_once(objective: TrainingObjective, claim: ClaimedTrial, watchdog: TrialWatchdog) -> TrialResult:
        attempts.append(claim)
        if len(attempts) == 1:
            raise ValueError("raised on purpose")
        return train(objective, claim, watchdog)

    monkeypatch.setattr(TrainingObjective, "__call__", fail_once)
    monkeypatch.setattr(trial_runner, "TrialRunner", lambda *_: shared)
    costs = benchmark.measure_trial_cost(BUDGET, shared.data, job_selection.select_points(NUMBERS[:2]))
    assert costs["trials"] == 2 and len(attempts) == 3 and costs["trial_s"] > 0


@pytest.mark.parametrize("losses", [[1.0], [0.5, 0.5], [3.0, 0.0, 1e3]])
def test_loss_curves_of_extreme_losses_are_drawn(losses: list[float]) -> None:
    image = cv2.imdecode(np.frombuffer(artifacts.draw_loss_curve(losses), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None and (image < 128).any(axis=-1).sum() > 20
