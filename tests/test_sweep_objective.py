"""What is kept of a trial: values, attributes, pictures, the best networks."""

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from optuna.trial import TrialState
from sweep_trial import BUDGET, trainer

from laesi_tf.common.run_files import CONFIG_FILE
from laesi_tf.models.saved_model import load_run
from laesi_tf.training.config_files import load_config
from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.tpe_queue import PRUNED_AT, TpeQueue
from sweeps.queue.trial_queue import Job
from sweeps.trials import artifacts
from sweeps.trials.objective import TrainingObjective
from sweeps.trials.search_space import FACTORS, POINTS, Point
from sweeps.trials.trial_runner import TrialRunner
from sweeps.workers.worker import run_trials

# One network and optimizer, so that one compiled step does.
CHOSEN = [n for n, p in enumerate(POINTS) if (p.start, p.optimizer) == ("small_imagenet", "sgd")][:4]
SEARCHED = FACTORS | {"start": ("small_imagenet",), "optimizer": ("sgd",)}


@pytest.fixture(scope="module")
def shared() -> Iterator[TrialRunner]:
    yield trainer()


def store(folder: Path) -> StudyStorage:
    return StudyStorage(str(folder / "study.db"), RetryPolicy())


def test_trials_are_kept_with_all_that_the_dashboard_shows(shared: TrialRunner, tmp_path: Path) -> None:
    ledger = GridQueue(store(tmp_path), "grid", FACTORS)
    ledger.fill(job_selection.select_points(CHOSEN))
    run_trials(ledger, TrainingObjective(shared, ledger, tmp_path))
    trials = [standing.complete for standing in ledger.standings().values()]
    attributes = {"images_per_s", "parameters", "inference_ms", "checkpoint", "seed", "median", "worker"}
    best = float("inf")
    for trial in trials:
        assert trial is not None and trial.values is not None
        assert set(trial.user_attrs) > attributes
        assert trial.values[1] == trial.user_attrs["inference_ms"] == trials[0].values[1] > 0
        pictures = [json.loads(text) for key, text in trial.system_attrs.items() if "artifacts:" in key]
        assert sorted(picture["filename"] for picture in pictures) == ["loss.png", "worst.jpg"]
        for picture in pictures:
            data = np.fromfile(tmp_path / "artifacts" / picture["artifact_id"], np.uint8)
            assert cv2.imdecode(data, cv2.IMREAD_COLOR).shape[1] > 300
        assert bool(trial.user_attrs["checkpoint"]) == (trial.values[0] < best)
        best = min(best, trial.values[0])
    kept = next(t for t in trials if t and t.values[0] == best)
    run = load_run(tmp_path / "checkpoints" / kept.user_attrs["checkpoint"])
    assert load_config(run.path / CONFIG_FILE) == BUDGET.config(Point(**kept.params), 0)
    images = shared.pictures.validation[0][0]
    again = shared.run(Point(**kept.params), 0)
    predicted = np.exp(run.model(images, training=False).numpy()[:, 0])
    np.testing.assert_allclose(predicted, again.found["predicted"], rtol=1e-4)


def test_a_divergence_is_told_and_tried_with_other_seeds(
    shared: TrialRunner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger = GridQueue(store(tmp_path), "grid", FACTORS)
    ledger.fill(job_selection.select_points(CHOSEN[:1]))
    clean, seeds = shared.pictures.training, []

    def poisoned(augmentations: tuple[str, ...], seed: int):  # type: ignore[no-untyped-def]
        seeds.append(seed)
        for images, target in clean(augmentations, seed):
            yield images, target * (np.nan if seed == 0 else 1.0)

    shared.prepare(POINTS[CHOSEN[0]], 0)
    monkeypatch.setattr(shared.pictures, "training", poisoned)
    run_trials(ledger, TrainingObjective(shared, ledger, tmp_path))
    (standing,) = ledger.standings().values()
    assert [trial.user_attrs["reason"] for trial in standing.failed] == ["training diverged: nan at step 1"]
    assert standing.complete is not None and standing.complete.user_attrs["seed"] == 1000
    assert seeds == [0, 1000] and standing.job.seed == 0


def test_a_search_trains_the_same_points_and_prunes(shared: TrialRunner, tmp_path: Path) -> None:
    search = TpeQueue(store(tmp_path), "tpe", SEARCHED, trials=16, seed=0)
    run_trials(search, TrainingObjective(shared, search, tmp_path))
    ended = [trial for trial in search.trials() if trial.state is TrialState.COMPLETE]
    pruned = [trial for trial in search.trials() if trial.state is TrialState.PRUNED]
    assert len(ended) + len(pruned) == 16 and pruned
    assert {trial.user_attrs[PRUNED_AT] for trial in pruned} <= {1, 2}
    assert shared.run(Point(**ended[0].params), 0).mre == ended[0].values[0]


def test_charts_of_odd_losses_are_drawn() -> None:
    for losses in ([1.0], [0.5, 0.5], [3.0, 0.0, 1e3]):
        drawn = cv2.imdecode(np.frombuffer(artifacts.draw_loss_curve(losses), np.uint8), cv2.IMREAD_COLOR)
        assert (drawn < 128).any(axis=-1).sum() > 20


def test_finalists_are_the_best_and_the_papers_optimum(tmp_path: Path) -> None:
    ledger = GridQueue(store(tmp_path), "grid", FACTORS)
    ledger.fill(job_selection.select_points(range(6)))
    while claim := ledger.claim():
        ledger.finish(claim, [abs(int(claim.job.name) - 4) + 1.0, 1.0], {})
    chosen = job_selection.select_finalists(ledger.standings(), count=2, seeds=3)
    assert [job.name for job in chosen] == [
        f"{n}/{seed}" for n in ("0004", "0003", "0002") for seed in (1, 2, 3)
    ]
    assert all(isinstance(job, Job) and job.seed == int(job.name[-1]) for job in chosen)
    # From best to worst the points are 4, 3, 5, 2, 1, 0.
    spread = job_selection.select_across_ranking(ledger.standings(), count=3, seeds=1)
    assert [job.name for job in spread] == ["0004/1", "0005/1", "0000/1"]
    assert len(job_selection.select_across_ranking(ledger.standings(), count=99, seeds=2)) == 12
