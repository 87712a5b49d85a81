"""A free search: as many trials as were asked for, hopeless ones cut short, failed ones replaced."""

from pathlib import Path

import pytest
from optuna.trial import TrialState

from sweeps.analysis import trial_table
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.tpe_queue import PRUNED_AT, TpeQueue
from sweeps.queue.trial_queue import ClaimedTrial
from sweeps.workers.watchdog import TrialWatchdog
from sweeps.workers.worker import TrialResult, run_trials

FACTORS = {"one": ("good", "bad"), "other": tuple("abcdefgh")}


def search(path: Path, trials: int = 40) -> TpeQueue:
    return TpeQueue(
        StudyStorage(str(path / "study.db"), RetryPolicy()), "tpe", FACTORS, trials=trials, seed=0
    )


def value(claim: ClaimedTrial) -> float:
    return 10.0 * (claim.job.levels["one"] == "bad") + "abcdefgh".index(claim.job.levels["other"])


def objective(book: TpeQueue, claim: ClaimedTrial) -> TrialResult:
    if claim.number in (3, 4):
        raise ValueError("as it was told")
    if book.hopeless(claim, 10, value(claim)):
        return TrialResult([value(claim), 1.0], {PRUNED_AT: 10})
    return TrialResult([value(claim), 1.0], {})


def test_it_makes_as_many_trials_as_are_wanted_and_prunes(tmp_path: Path) -> None:
    book = search(tmp_path)
    run_trials(book, lambda claim, clock: objective(book, claim))
    counts = book.counts()
    assert counts[TrialState.FAIL] == 2 and counts[TrialState.COMPLETE] + counts[TrialState.PRUNED] == 40
    assert counts[TrialState.PRUNED] >= 3
    trials = book.trials()
    assert {trial.user_attrs["seed"] for trial in trials} == {0}
    for trial in trials:
        if trial.state is TrialState.PRUNED:
            assert trial.user_attrs[PRUNED_AT] == 10 and trial.number >= 10
    later = [t.params["one"] for t in trials[-15:]]
    assert later.count("good") > 10, "it learns which is the better level"
    # Starting again finds it done.
    run_trials(search(tmp_path), lambda claim, clock: pytest.fail("nothing is left to do"))


def test_two_searchers_share_the_number_of_trials_and_propose_unlike(tmp_path: Path) -> None:
    one, other = search(tmp_path, trials=6), search(tmp_path, trials=6)
    claims = [book.claim() for _ in range(3) for book in (one, other)]
    assert len({claim.trial_id for claim in claims if claim}) == 6
    assert one.claim() is None and not one.finished()
    assert len({str(claim.job.levels) for claim in claims if claim}) > 3


def test_the_same_trials_are_proposed_again(tmp_path: Path) -> None:
    found = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        book = search(tmp_path / name, trials=15)
        run_trials(book, lambda claim, clock: TrialResult([value(claim), 1.0], {}))
        found.append([trial.params for trial in book.trials()])
    assert found[0] == found[1]


def test_a_claim_that_was_not_finished_is_not_waited_for(tmp_path: Path) -> None:
    book = search(tmp_path, trials=2)
    book.study.ask()  # and killed before its first heartbeat, its job and its seed
    run_trials(book, lambda claim, clock: TrialResult([value(claim), 1.0], {}))
    assert book.counts()[TrialState.COMPLETE] == 2
    assert book.trials()[0].user_attrs["reason"] == "the claim was not finished"
    assert trial_table.write_failures(tmp_path / "failures.csv", book.trials()) == 1


def test_a_lost_searchers_trial_is_replaced(tmp_path: Path) -> None:
    rules = RetryPolicy(heartbeat_s=1, grace_s=1)
    book = TpeQueue(StudyStorage(str(tmp_path / "study.db"), rules), "tpe", FACTORS, trials=2, seed=0)
    assert book.claim() is not None  # and its worker is never heard of again
    done = []

    def told(claim: ClaimedTrial, clock: TrialWatchdog) -> TrialResult:
        done.append(claim.number)
        return TrialResult([value(claim), 1.0], {})

    run_trials(book, told)
    assert book.counts()[TrialState.COMPLETE] == 2 and len(done) == 2
    assert "no sign of life" in book.trials()[0].user_attrs["reason"]
