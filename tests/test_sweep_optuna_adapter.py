"""The private parts of Optuna that the queues use do what the adapter promises."""

import time
from pathlib import Path

import pytest
from optuna.trial import TrialState

from sweeps.queue import optuna_adapter
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.trial_queue import JOB, REASON, Job


@pytest.fixture
def queue(tmp_path: Path) -> GridQueue:
    """Two jobs in a storage whose workers count as lost after a second."""
    storage = StudyStorage(str(tmp_path / "study.db"), RetryPolicy(heartbeat_s=1, grace_s=1))
    queue = GridQueue(storage, "study", {"level": ("a", "b")})
    queue.enqueue(Job(f"{n:04d}", {"level": level}, 0) for n, level in enumerate("ab"))
    return queue


def test_ids_are_those_of_the_storage(queue: GridQueue) -> None:
    rdb = queue.storage.rdb
    assert optuna_adapter.study_id(rdb, "study") == queue.study_id
    for trial in queue.get_trials():
        assert rdb.get_trial(optuna_adapter.trial_id(trial)).number == trial.number


def test_trials_are_counted_as_optuna_reads_them(queue: GridQueue) -> None:
    claim = queue.claim()
    assert claim is not None
    queue.finish(claim, [1.0, 1.0], {})
    counts = optuna_adapter.count_trials(queue.storage.rdb, queue.study_id)
    states = [trial.state for trial in queue.get_trials()]
    assert counts == {state: states.count(state) for state in TrialState}


def test_a_running_trial_without_a_heartbeat_becomes_stale(queue: GridQueue) -> None:
    rdb, alive, silent = queue.storage.rdb, queue.claim(), queue.claim()
    assert alive is not None and silent is not None
    assert not optuna_adapter.stale_trial_ids(rdb, queue.study_id)
    time.sleep(2.5)
    optuna_adapter.send_heartbeat(rdb, alive.trial_id)
    assert list(optuna_adapter.stale_trial_ids(rdb, queue.study_id)) == [silent.trial_id]


def test_intermediate_values_are_reported_to_a_running_trial(queue: GridQueue) -> None:
    claim = queue.claim()
    assert claim is not None
    trial = optuna_adapter.resume_trial(queue.study, claim.trial_id)
    assert trial.number == claim.number and trial.params == claim.job.levels


def test_summaries_equal_what_optuna_reads(queue: GridQueue) -> None:
    rdb = queue.storage.rdb
    first = queue.claim()
    assert first is not None
    queue.fail(first, "failed on purpose")
    trials = queue.get_trials()
    summaries = optuna_adapter.summarise_trials(rdb, queue.study_id, (JOB, REASON))
    assert [trial.number for trial in summaries] == [trial.number for trial in trials]
    for summary, trial in zip(summaries, trials, strict=True):
        assert (summary.trial_id, summary.state) == (optuna_adapter.trial_id(trial), trial.state)
        expected = {name: trial.user_attrs[name] for name in (JOB, REASON) if name in trial.user_attrs}
        assert summary.user_attrs == expected
    waiting = {optuna_adapter.trial_id(trial) for trial in trials if trial.state is TrialState.WAITING}
    assert optuna_adapter.waiting_trial_ids(rdb, queue.study_id) == waiting and len(waiting) == 2


def test_parameters_are_positions_of_levels(queue: GridQueue) -> None:
    parameters = optuna_adapter.read_parameters(queue.storage.rdb, queue.study_id)
    for trial in queue.get_trials():
        assert "ab"[int(parameters[optuna_adapter.trial_id(trial)]["level"])] == trial.params["level"]
