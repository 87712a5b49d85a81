"""A storage that cannot be opened is refused with what to do; a study of an earlier version continues."""

import sqlite3
from pathlib import Path

import pytest
from optuna.trial import TrialState

from laesi_tf.common.errors import InputError
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage, open_existing_storage
from sweeps.queue.tpe_queue import TpeQueue
from sweeps.trials.search_space import FACTORS

OLD_STUDY = Path(__file__).parent / "data" / "sweep_study_0.1.0.sql"
OLD_BUDGET = {
    "size": 32,
    "batch_size": 8,
    "steps": 4,
    "pictures": 16,
    "validation": 64,
    "calibration": 32,
    "alpha": 0.35,
    "large": "large",
    "weights_large": "none",
    "weights_small": "none",
}


@pytest.mark.parametrize(
    ("location", "message"),
    [
        (".", "is a folder"),
        ("mysql://host/base", "is not supported; name a file, or postgresql"),
        ("postgresql://laesi@127.0.0.1:9/none", "cannot open storage"),
        ("postgresql://nobody@127.0.0.1:notaport/db", "not a valid address .* with a number as PORT"),
        ("sqlite:///x.db", r"name the file itself, --storage x\.db"),
        ("/proc/study.db", "cannot write /proc/study.db.lock: .*choose another --storage"),
    ],
)
def test_a_storage_that_cannot_be_opened_is_refused(location: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        StudyStorage(location, RetryPolicy())


def test_messages_do_not_show_a_password() -> None:
    for location in ("postgresql://me:secret@127.0.0.1:notaport/db", "postgresql://me:secret@127.0.0.1:9/db"):
        with pytest.raises(InputError) as refused:
            StudyStorage(location, RetryPolicy())
        assert "secret" not in str(refused.value) and "me:***@" in str(refused.value)


def test_a_missing_file_is_not_created(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no storage .*study\.db"):
        open_existing_storage(str(tmp_path / "study.db"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("values", "message"),
    [({"retries": -1}, "--retries is -1"), ({"time_limit_s": 0.0}, "--time-limit is 0 s")],
)
def test_impossible_policies_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RetryPolicy(**values)  # type: ignore[arg-type]


def test_a_study_of_version_0_1_0_continues(tmp_path: Path) -> None:
    """Two of its four points are complete, one has failed once, one was running when its worker died."""
    location = str(tmp_path / "study.db")
    with sqlite3.connect(location) as connection:
        connection.executescript(OLD_STUDY.read_text(encoding="utf-8"))
    storage = open_existing_storage(location)
    assert storage.study_names() == ["grid", "tpe"]
    queue = GridQueue(storage, "grid", FACTORS)
    queue.check_study_setting("budget", OLD_BUDGET)
    assert queue.measure_once("guess_mre", lambda: 0.0) == pytest.approx(72.657, abs=1e-3)
    queue.requeue_missing()
    first, retry = queue.claim(), queue.claim()
    assert first is not None and retry is not None and queue.claim() is None
    assert (first.job.name, retry.job.name) == ("0762", "0763")
    assert first.reasons == ("training diverged: nan at step 1",) and "worker lost" in retry.reasons[0]
    for claim in (first, retry):
        assert queue.finish(claim, [50.0, 1.0], {})
    assert queue.is_finished() and queue.expected_total() == 4
    search = TpeQueue(storage, "tpe", FACTORS, trials=4, seed=0)
    while claimed := search.claim():
        search.finish(claimed, [70.0, 1.0], {})
    assert search.count_by_state()[TrialState.COMPLETE] == 4
