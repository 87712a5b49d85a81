"""A search runs as many trials as asked for, prunes poor ones and replaces failed ones."""

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


def open_queue(folder: Path, trials: int = 40, policy: RetryPolicy | None = None) -> TpeQueue:
    storage = StudyStorage(str(folder / "study.db"), policy or RetryPolicy())
    return TpeQueue(storage, "tpe", FACTORS, trials=trials, seed=0)


def error_of(claim: ClaimedTrial) -> float:
    return 10.0 * (claim.job.levels["one"] == "bad") + "abcdefgh".index(claim.job.levels["other"])


def complete(claim: ClaimedTrial, _: TrialWatchdog) -> TrialResult:
    return TrialResult([error_of(claim), 1.0], {})


def test_it_runs_as_many_trials_as_asked_for_and_prunes(tmp_path: Path) -> None:
    queue = open_queue(tmp_path)

    def fail_two_and_prune(claim: ClaimedTrial, _: TrialWatchdog) -> TrialResult:
        if claim.number in (3, 4):
            raise ValueError("raised on purpose")
        pruned = {PRUNED_AT: 10} if queue.should_prune(claim, 10, error_of(claim)) else {}
        return TrialResult([error_of(claim), 1.0], pruned)

    run_trials(queue, fail_two_and_prune)
    counts = queue.count_by_state()
    assert counts[TrialState.FAIL] == 2 and counts[TrialState.COMPLETE] + counts[TrialState.PRUNED] == 40
    assert counts[TrialState.PRUNED] >= 3 and queue.expected_total() == 40 and not queue.list_given_up()
    trials = queue.get_trials()
    assert {trial.user_attrs["seed"] for trial in trials} == {0}
    for trial in trials:
        if trial.state is TrialState.PRUNED:
            assert trial.user_attrs[PRUNED_AT] == 10 and trial.number >= 10
    later = [trial.params["one"] for trial in trials[-15:]]
    assert later.count("good") > 10, "it learns which level is better"
    # Another worker finds the search finished.
    run_trials(open_queue(tmp_path), lambda claim, watchdog: pytest.fail("nothing is left to do"))


def test_two_workers_share_the_number_of_trials_and_propose_different_ones(tmp_path: Path) -> None:
    one, other = open_queue(tmp_path, trials=6), open_queue(tmp_path, trials=6)
    claims = [queue.claim() for _ in range(3) for queue in (one, other)]
    assert len({claim.trial_id for claim in claims if claim}) == 6
    assert one.claim() is None and not one.is_finished()
    assert len({str(claim.job.levels) for claim in claims if claim}) > 3


def test_a_search_repeats_its_proposals(tmp_path: Path) -> None:
    proposals = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        queue = open_queue(tmp_path / name, trials=15)
        run_trials(queue, complete)
        proposals.append([trial.params for trial in queue.get_trials()])
    assert proposals[0] == proposals[1]


def test_an_interrupted_claim_is_replaced(tmp_path: Path) -> None:
    queue = open_queue(tmp_path, trials=2)
    queue.study.ask()  # and killed before its first heartbeat, its job and its seed
    run_trials(queue, complete)
    assert queue.count_by_state()[TrialState.COMPLETE] == 2
    assert queue.get_trials()[0].user_attrs["reason"] == "the claim was interrupted"
    assert trial_table.write_failures(tmp_path / "failures.csv", queue.get_trials()) == 1


def test_the_trial_of_a_lost_worker_is_replaced(tmp_path: Path) -> None:
    queue = open_queue(tmp_path, trials=2, policy=RetryPolicy(heartbeat_s=1, grace_s=1))
    assert queue.claim() is not None  # by a worker that sends no heartbeat
    run_trials(queue, complete)
    counts = queue.count_by_state()
    assert counts[TrialState.COMPLETE] == 2 and counts[TrialState.FAIL] == 1
    assert "no heartbeat" in queue.get_trials()[0].user_attrs["reason"]
