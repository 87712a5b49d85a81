"""Each job completes exactly once, even if a worker, a trial or the database fails."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import fake_sweep_worker as fake
import postgres
import pytest
from optuna.trial import TrialState

from laesi_tf.common.errors import InputError
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StorageUnreachable
from sweeps.queue.trial_queue import ClaimedTrial
from sweeps.workers import worker, worker_pool
from sweeps.workers.watchdog import TrialWatchdog
from sweeps.workers.worker import TrialResult

HERE = Path(__file__).parent


@pytest.fixture(params=["file", pytest.param("postgresql", marks=postgres.needs_postgres)])
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "file":
        return str(tmp_path / "study.db")
    location: str = request.getfixturevalue("server").create_database(tmp_path.name)
    return location


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


def count_starts(log: Path) -> Counter[str]:
    """Return how often each job was started."""
    return Counter(line.split()[0] for line in log.read_text().splitlines())


def start_worker(storage: str, log: Path) -> subprocess.Popen[bytes]:
    path = os.pathsep.join([str(HERE), str(HERE.parent)])
    command = [sys.executable, str(HERE / "fake_sweep_worker.py"), storage, str(log)]
    return subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path})


def failure_reasons(queue: GridQueue, number: int) -> list[str]:
    return [trial.user_attrs["reason"] for trial in queue.job_histories()[f"{number:04d}"].failed]


def test_four_workers_complete_each_job_once(storage: str, log: Path) -> None:
    queue = fake.open_queue(storage)
    assert queue.enqueue(fake.make_job(number, "good") for number in range(60)) == 60
    workers = [start_worker(storage, log) for _ in range(4)]
    assert [worker.wait(120) for worker in workers] == [0] * 4
    assert count_starts(log) == {f"{number:04d}": 1 for number in range(60)}
    assert queue.count_by_state()[TrialState.COMPLETE] == sum(queue.count_by_state().values()) == 60
    assert queue.expected_total() == 60 and not queue.list_given_up()
    for history in queue.job_histories().values():
        assert history.complete is not None and history.complete.values[0] == history.job.seed
    pids = {line.split()[2] for line in log.read_text().splitlines()}
    assert len(pids) == 4
    # Another worker finds nothing to do, and enqueueing the same jobs adds nothing.
    assert queue.enqueue(fake.make_job(number, "good") for number in range(60)) == 0
    assert start_worker(storage, log).wait(60) == 0 and count_starts(log).total() == 60


def test_failures_are_recorded_with_their_reason_and_retried(storage: str, log: Path) -> None:
    queue = fake.open_queue(storage)
    # Failing jobs between good ones, so that no ten in a row fail.
    behaviours = [name for failing in fake.BEHAVIOURS[1:] for name in ("good", failing, "good")]
    fake.release_file(log).touch()
    queue.enqueue(fake.make_job(number, name) for number, name in enumerate(behaviours))
    worker_pool.run_worker_pool(fake.run_worker, (storage, str(log)), workers=3, queue=queue)
    histories = queue.job_histories()
    always_failing = {"raises", "diverges", "not_finite"}
    for number, behaviour in enumerate(behaviours):
        history = histories[f"{number:04d}"]
        assert not history.running and not history.waiting
        assert bool(history.complete) == (behaviour not in always_failing), behaviour
        reasons = failure_reasons(queue, number)
        never_failing = {"good", "long", "held"}
        expected = 3 if behaviour in always_failing else int(behaviour not in never_failing)
        assert len(reasons) == expected, behaviour
        assert count_starts(log)[f"{number:04d}"] == len(reasons) + bool(history.complete)
    reasons_of = {name: failure_reasons(queue, number) for number, name in enumerate(behaviours)}
    assert reasons_of["raises"] == ["ValueError: raised on purpose"] * 3
    assert reasons_of["diverges"] == ["training diverged: nan at step 3"] * 3
    assert "not finite: [nan" in reasons_of["not_finite"][0]
    assert reasons_of["slow_once"] == ["over its time limit of 1 s"]
    assert reasons_of["stuck_once"] == ["over its time limit of 1 s, and stuck"]
    assert reasons_of["dies_once"] == ["worker lost: no heartbeat for 3 s"]
    given_up = queue.list_given_up()
    assert sorted(given_up) == [
        f"{n:04d}" for n, behaviour in enumerate(behaviours) if behaviour in always_failing
    ]
    assert ["ValueError: raised on purpose"] * 3 in given_up.values()


def test_a_killed_worker_loses_and_repeats_no_job(storage: str, log: Path) -> None:
    queue = fake.open_queue(storage)
    queue.enqueue(fake.make_job(number, "long" if number % 3 else "good") for number in range(9))
    worker = start_worker(storage, log)
    while not log.exists() or count_starts(log).total() < 5:
        assert worker.poll() is None
        time.sleep(0.02)
    worker.send_signal(signal.SIGKILL)
    worker.wait()
    complete = queue.count_by_state()[TrialState.COMPLETE]
    assert 3 <= complete < 9 and queue.count_by_state()[TrialState.RUNNING] == 1
    assert start_worker(storage, log).wait(60) == 0
    counts = queue.count_by_state()
    assert (counts[TrialState.COMPLETE], counts[TrialState.FAIL]) == (9, 1)
    assert all(history.complete for history in queue.job_histories().values())
    assert sorted(count_starts(log).values()) == [1] * 8 + [2]


def test_the_result_of_a_worker_that_was_counted_as_lost_is_ignored(storage: str) -> None:
    queue = fake.open_queue(storage)
    queue.enqueue([fake.make_job(0, "good")])
    lost = queue.claim()
    assert lost is not None
    queue.fail(lost, "counted as lost")
    retry = queue.claim()
    assert retry is not None and retry.attempt == 2
    assert not queue.finish(lost, [1.0, 1.0], {})
    assert queue.finish(retry, [2.0, 1.0], {})
    # As after a connection that broke once the trial was complete.
    assert queue.finish(retry, [2.0, 1.0], {})
    complete = queue.job_histories()["0000"].complete
    assert complete is not None and complete.values == [2.0, 1.0]


def test_a_job_that_was_queued_twice_runs_once(storage: str) -> None:
    queue = fake.open_queue(storage)
    queue.enqueue([fake.make_job(0, "good")])
    queue._queue_job(fake.make_job(0, "good"))
    claim = queue.claim()
    assert claim is not None and queue.claim() is None
    assert failure_reasons(queue, 0) == ["queued twice"]
    assert queue.job_histories()["0000"].failure_count == 0


def test_a_worker_releases_its_trial_on_sigterm_without_a_failure(storage: str, log: Path) -> None:
    queue = fake.open_queue(storage)
    queue.enqueue([fake.make_job(0, "long")])
    worker = start_worker(storage, log)
    while not log.exists():
        assert worker.poll() is None
        time.sleep(0.02)
    worker.send_signal(signal.SIGINT)  # Ctrl-C, which all processes get; the supervisor's SIGTERM follows
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(30) != 0
    history = queue.job_histories()["0000"]
    assert history.waiting and history.failure_count == 0
    assert failure_reasons(queue, 0) == ["stopped: KeyboardInterrupt"]


def test_heartbeats_continue_until_the_end_of_a_trial_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue = fake.open_queue(str(tmp_path / "study.db"))
    queue.enqueue([fake.make_job(0, "good")])
    watchdog, claim = TrialWatchdog(queue), queue.claim()
    assert claim is not None
    finish, watched = queue.finish, []

    def finish_watched(*arguments: Any) -> bool:
        # Waiting for the lock may take longer than the trial's own time limit.
        watched.append((watchdog._claim, watchdog._stuck_at))
        return finish(*arguments)

    def objective(claim: ClaimedTrial, watchdog: TrialWatchdog) -> TrialResult:
        watchdog.start_clock()
        return TrialResult([1.0, 1.0], {})

    monkeypatch.setattr(queue, "finish", finish_watched)
    assert worker._run_trial(queue, watchdog, claim, objective) == ""
    assert watched == [(claim, float("inf"))] and watchdog._claim is None
    assert queue.job_histories()["0000"].complete


@postgres.needs_postgres
def test_workers_wait_for_a_database_that_is_offline(
    server: postgres.Server, tmp_path: Path, log: Path
) -> None:
    storage = server.create_database(tmp_path.name)
    queue = fake.open_queue(storage)
    queue.enqueue(fake.make_job(number, "held") for number in range(8))
    workers = [start_worker(storage, log) for _ in range(2)]
    # Both are inside a trial when the database goes, however late one of them started.
    while not log.exists() or count_starts(log).total() < 2:
        assert all(worker.poll() is None for worker in workers)
        time.sleep(0.02)
    server.stop()
    fake.release_file(log).touch()
    time.sleep(2.5)
    server.start()
    assert [worker.wait(120) for worker in workers] == [0, 0]
    histories = queue.storage.retry_while_offline(queue.job_histories)
    assert len(histories) == 8
    assert all(history.complete and not history.waiting for history in histories.values())
    assert queue.count_by_state()[TrialState.COMPLETE] == 8
    outages = [h.complete.user_attrs.get("interrupted", "") for h in histories.values() if h.complete]
    assert sum("database offline, for" in outage for outage in outages) == 2


@postgres.needs_postgres
def test_waiting_for_a_database_ends(server: postgres.Server, tmp_path: Path) -> None:
    queue = fake.open_queue(server.create_database(tmp_path.name), RetryPolicy(patience_s=1.0))
    server.stop()
    try:
        with pytest.raises(StorageUnreachable, match="database offline"):
            queue.storage.retry_while_offline(queue.claim)
    finally:
        server.start()
    queue.storage.retry_while_offline(queue.requeue_missing)


def test_a_worker_stays_in_its_group_and_shares_the_last_one(storage: str) -> None:
    one, other = fake.open_queue(storage), fake.open_queue(storage)
    one.enqueue(fake.make_job(number, "good") for number in range(30))

    def claim_group(queue: GridQueue) -> int:
        claim = queue.claim()
        assert claim is not None
        return int(claim.job.name) // 10

    groups = [(claim_group(one), claim_group(other)) for _ in range(10)]
    assert set(groups) == {(0, 1)}
    assert [claim_group(one), claim_group(other)] == [2, 2]


def test_no_worker_counts_as_lost_while_the_database_is_offline(storage: str) -> None:
    queue = fake.open_queue(storage, RetryPolicy(heartbeat_s=1, grace_s=2))
    queue.enqueue([fake.make_job(0, "good")])
    assert queue.claim() is not None
    time.sleep(3.5)
    queue.storage.last_offline_at = time.monotonic()
    queue.requeue_missing()
    assert queue.job_histories()["0000"].running
    queue.storage.last_offline_at -= 3
    queue.requeue_missing()
    assert queue.job_histories()["0000"].waiting


def test_a_study_without_trials_takes_another_budget(storage: str) -> None:
    queue = fake.open_queue(storage)
    queue.check_study_setting("budget", {"steps": 40})
    assert queue.measure_once("guess", lambda: 1.0) == 1.0
    queue.check_study_setting("budget", {"steps": 30})
    assert queue.measure_once("guess", lambda: 2.0) == queue.measure_once("guess", lambda: 3.0) == 2.0


def test_a_study_with_trials_refuses_another_budget(storage: str) -> None:
    queue = fake.open_queue(storage)
    queue.check_study_setting("budget", {"steps": 40, "size": 64})
    queue.enqueue([fake.make_job(0, "good")])
    assert queue.claim() is not None
    fake.open_queue(storage).check_study_setting("budget", {"steps": 40, "size": 64})
    with pytest.raises(InputError, match="steps is 40 there and 30 here"):
        fake.open_queue(storage).check_study_setting("budget", {"steps": 30, "size": 64})
