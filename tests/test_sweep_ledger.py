"""Every job is completed once, whatever becomes of workers, trials and the database."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import postgres
import pytest
import sweep_worker as fake
from optuna.trial import TrialState

from laesi_tf.common.errors import InputError
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StorageUnreachable, StudyStorage
from sweeps.workers import worker_pool

HERE = Path(__file__).parent
needs_postgres = pytest.mark.skipif(
    postgres.binaries() is None, reason="no postgres binary; apt-get install postgresql"
)


@pytest.fixture(scope="module")
def server() -> Iterator[postgres.Server]:
    with postgres.server() as running:
        yield running


@pytest.fixture(params=["file", pytest.param("postgresql", marks=needs_postgres)])
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "file":
        return str(tmp_path / "study.db")
    return request.getfixturevalue("server").database(tmp_path.name)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


def begun(log: Path) -> Counter[str]:
    """How often each job was begun."""
    return Counter(line.split()[0] for line in log.read_text().splitlines())


def started(storage: str, log: Path) -> subprocess.Popen[bytes]:
    path = os.pathsep.join([str(HERE), str(HERE.parent)])
    command = [sys.executable, str(HERE / "sweep_worker.py"), storage, str(log)]
    return subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path})


def reasons(ledger: GridQueue, number: int) -> list[str]:
    return [trial.user_attrs["reason"] for trial in ledger.standings()[f"{number:04d}"].failed]


def test_four_workers_do_every_job_once(storage: str, log: Path) -> None:
    ledger = fake.ledger(storage)
    assert ledger.fill(fake.job(number, "good") for number in range(60)) == 60
    workers = [started(storage, log) for _ in range(4)]
    assert [worker.wait(120) for worker in workers] == [0] * 4
    assert begun(log) == {f"{number:04d}": 1 for number in range(60)}
    assert ledger.counts()[TrialState.COMPLETE] == sum(ledger.counts().values()) == 60
    assert all(standing.complete.values[0] == standing.job.seed for standing in ledger.standings().values())
    pids = {line.split()[2] for line in log.read_text().splitlines()}
    assert len(pids) == 4
    # Starting again finds nothing to do, and filling again adds nothing.
    assert ledger.fill(fake.job(number, "good") for number in range(60)) == 0
    assert started(storage, log).wait(60) == 0 and begun(log).total() == 60


def test_what_ends_badly_is_told_and_tried_again(storage: str, log: Path) -> None:
    ledger = fake.ledger(storage)
    # Bad ones between good ones, so that no ten in a row fail.
    kinds = [kind for bad in fake.KINDS[1:] for kind in ("good", bad, "good")]
    ledger.fill(fake.job(number, kind) for number, kind in enumerate(kinds))
    worker_pool.run_worker_pool(fake.target, (storage, str(log)), workers=3, book=ledger, total=len(kinds))
    found = ledger.standings()
    hopeless = {"raises", "diverges", "no_number"}
    for number, kind in enumerate(kinds):
        standing = found[f"{number:04d}"]
        assert not standing.running and not standing.waiting
        assert bool(standing.complete) == (kind not in hopeless), kind
        told = reasons(ledger, number)
        assert len(told) == {"good": 0, "long": 0}.get(kind, 3 if kind in hopeless else 1), kind
        assert begun(log)[f"{number:04d}"] == len(told) + bool(standing.complete)
    of = {kind: reasons(ledger, number) for number, kind in enumerate(kinds)}
    assert of["raises"] == ["ValueError: as it was told"] * 3
    assert of["diverges"] == ["training diverged: nan at step 3"] * 3
    assert "no number: [nan" in of["no_number"][0]
    assert of["slow_once"] == ["over its time limit of 1 s"]
    assert of["stuck_once"] == ["over its time limit of 1 s, and stuck"]
    assert of["dies_once"] == ["worker lost: no sign of life for 3 s"]


def test_a_worker_killed_in_a_trial_loses_and_doubles_nothing(storage: str, log: Path) -> None:
    ledger = fake.ledger(storage)
    ledger.fill(fake.job(number, "long" if number % 3 else "good") for number in range(9))
    worker = started(storage, log)
    while not log.exists() or begun(log).total() < 5:
        assert worker.poll() is None
        time.sleep(0.02)
    worker.send_signal(signal.SIGKILL)
    worker.wait()
    done = ledger.counts()[TrialState.COMPLETE]
    assert 3 <= done < 9 and ledger.counts()[TrialState.RUNNING] == 1
    assert started(storage, log).wait(60) == 0
    counts = ledger.counts()
    assert (counts[TrialState.COMPLETE], counts[TrialState.FAIL]) == (9, 1)
    assert all(standing.complete for standing in ledger.standings().values())
    assert sorted(begun(log).values()) == [1] * 8 + [2]


def test_a_worker_that_was_given_up_for_lost_tells_in_vain(storage: str) -> None:
    ledger = fake.ledger(storage)
    ledger.fill([fake.job(0, "good")])
    asleep = ledger.claim()
    assert asleep is not None
    ledger.fail(asleep, "taken for dead")
    again = ledger.claim()
    assert again is not None and again.attempt == 2
    assert not ledger.finish(asleep, [1.0, 1.0], {})
    assert ledger.finish(again, [2.0, 1.0], {})
    # As after a connection that broke when it was done.
    assert ledger.finish(again, [2.0, 1.0], {})
    complete = ledger.standings()["0000"].complete
    assert complete is not None and complete.values == [2.0, 1.0]


def test_a_job_queued_twice_is_done_once(storage: str) -> None:
    ledger = fake.ledger(storage)
    ledger.fill([fake.job(0, "good")])
    ledger._queue(fake.job(0, "good"))
    claim = ledger.claim()
    assert claim is not None and ledger.claim() is None
    assert reasons(ledger, 0) == ["queued twice"] and ledger.standings()["0000"].held_against == 0


def test_a_worker_asked_to_end_hands_its_trial_back_at_no_cost(storage: str, log: Path) -> None:
    ledger = fake.ledger(storage)
    ledger.fill([fake.job(0, "long")])
    worker = started(storage, log)
    while not log.exists():
        assert worker.poll() is None
        time.sleep(0.02)
    worker.send_signal(signal.SIGINT)  # Ctrl-C, which goes to all: the supervisor's SIGTERM follows
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(30) != 0
    standing = ledger.standings()["0000"]
    assert standing.waiting and standing.held_against == 0
    assert reasons(ledger, 0) == ["stopped: KeyboardInterrupt"]


@needs_postgres
def test_a_database_that_goes_and_comes_back_is_waited_for(
    server: postgres.Server, tmp_path: Path, log: Path
) -> None:
    storage = server.database(tmp_path.name)
    ledger = fake.ledger(storage)
    ledger.fill(fake.job(number, "long") for number in range(8))
    workers = [started(storage, log) for _ in range(2)]
    while not log.exists() or begun(log).total() < 3:
        assert all(worker.poll() is None for worker in workers)
        time.sleep(0.02)
    server.stop()
    time.sleep(2.5)
    server.start()
    assert [worker.wait(120) for worker in workers] == [0, 0]
    standings = ledger.store.patiently(ledger.standings)
    assert len(standings) == 8
    assert all(standing.complete and not standing.waiting for standing in standings.values())
    assert ledger.counts()[TrialState.COMPLETE] == 8
    told = [one.complete.user_attrs.get("interrupted", "") for one in standings.values() if one.complete]
    assert sum("database away, for" in one for one in told) >= 2


@needs_postgres
def test_patience_with_a_database_ends(server: postgres.Server, tmp_path: Path) -> None:
    ledger = fake.ledger(server.database(tmp_path.name), RetryPolicy(patience_s=1.0))
    server.stop()
    try:
        with pytest.raises(StorageUnreachable, match="database away"):
            ledger.store.patiently(ledger.claim)
    finally:
        server.start()
    ledger.store.patiently(ledger.settle)


def test_groups_are_kept_together_and_shared_last(storage: str) -> None:
    one, other = fake.ledger(storage), fake.ledger(storage)
    one.fill(fake.job(number, "good") for number in range(30))

    def next_group(ledger: GridQueue) -> int:
        claim = ledger.claim()
        assert claim is not None
        return int(claim.job.name) // 10

    groups = [(next_group(one), next_group(other)) for _ in range(10)]
    assert set(groups) == {(0, 1)}
    assert [next_group(one), next_group(other)] == [2, 2]


def test_no_one_is_lost_while_the_database_was_away(storage: str) -> None:
    ledger = fake.ledger(storage, RetryPolicy(heartbeat_s=1, grace_s=2))
    ledger.fill([fake.job(0, "good")])
    assert ledger.claim() is not None
    time.sleep(3.5)
    ledger.store.away_at = time.monotonic()
    ledger.settle()
    assert ledger.standings()["0000"].running
    ledger.store.away_at -= 3
    ledger.settle()
    assert ledger.standings()["0000"].waiting


def test_what_is_done_in_vain_does_not_settle_the_budget(storage: str) -> None:
    ledger = fake.ledger(storage)
    ledger.agree("budget", {"steps": 40})
    assert ledger.once("guess", lambda: 1.0) == 1.0
    ledger.agree("budget", {"steps": 30})
    assert ledger.once("guess", lambda: 2.0) == ledger.once("guess", lambda: 3.0) == 2.0


def test_studies_of_other_budgets_are_refused(storage: str) -> None:
    ledger = fake.ledger(storage)
    ledger.agree("budget", {"steps": 40, "size": 64})
    ledger.fill([fake.job(0, "good")])
    assert ledger.claim() is not None
    fake.ledger(storage).agree("budget", {"steps": 40, "size": 64})
    with pytest.raises(InputError, match="steps 40 there, 30 here"):
        fake.ledger(storage).agree("budget", {"steps": 30, "size": 64})


@pytest.mark.parametrize(
    ("where", "told"),
    [
        (".", "is a folder"),
        ("mysql://host/base", "neither a file nor postgresql"),
        ("postgresql://laesi@127.0.0.1:9/none", "cannot open the storage"),
    ],
)
def test_storages_that_cannot_be_opened(where: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        StudyStorage(where, RetryPolicy())
