"""Which points a study runs, and which it repeats."""

from pathlib import Path

import pytest

from laesi_tf.common.errors import InputError
from sweeps.queue import job_selection
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.trial_queue import Job
from sweeps.trials.search_space import FACTORS


def test_finalists_are_the_best_and_the_papers_optimum(tmp_path: Path) -> None:
    queue = GridQueue(StudyStorage(str(tmp_path / "study.db"), RetryPolicy()), "grid", FACTORS)
    queue.enqueue(job_selection.select_points(range(6)))
    while claim := queue.claim():
        queue.finish(claim, [abs(int(claim.job.name) - 4) + 1.0, 1.0], {})
    finalists = job_selection.select_finalists(queue.job_histories(), count=2, seeds=3)
    assert [job.name for job in finalists] == [
        f"{n}/{seed}" for n in ("0004", "0003", "0002") for seed in (1, 2, 3)
    ]
    assert all(isinstance(job, Job) and job.seed == int(job.name[-1]) for job in finalists)
    # From best to worst the points are 4, 3, 5, 2, 1, 0.
    spread = job_selection.select_across_ranking(queue.job_histories(), count=3, seeds=1)
    assert [job.name for job in spread] == ["0004/1", "0005/1", "0000/1"]
    assert len(job_selection.select_across_ranking(queue.job_histories(), count=99, seeds=2)) == 12


def test_an_incomplete_screening_is_refused(tmp_path: Path) -> None:
    queue = GridQueue(StudyStorage(str(tmp_path / "study.db"), RetryPolicy()), "grid", FACTORS)
    queue.enqueue(job_selection.select_points(range(2)))
    with pytest.raises(InputError, match="2 of 2 points are open"):
        job_selection.select_finalists(queue.job_histories(), count=1, seeds=1)


def test_point_numbers_are_parsed() -> None:
    assert job_selection.parse_point_numbers("5,0-2,1,1424") == [0, 1, 2, 5, 1424]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("7-x", "is not a list of numbers"),
        ("", "is not a list of numbers"),
        ("-3", "is not a list of numbers"),
        ("0-1425", "is not within 0-1424"),
        ("0-19,5-3", "5-3 is reversed; write 3-5"),
    ],
)
def test_wrong_point_numbers_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        job_selection.parse_point_numbers(text)
