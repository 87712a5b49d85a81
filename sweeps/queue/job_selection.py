"""Select the jobs of a study: points of the grid, or some of them again with several seeds."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from laesi_tf.common.errors import InputError
from sweeps.queue.grid_queue import JobHistory
from sweeps.queue.trial_queue import Job
from sweeps.trials.search_space import OPTIMUM, POINTS

SCREENING_SEED = 0


def select_points(numbers: Sequence[int]) -> list[Job]:
    """Return the jobs of these points, all with one seed, so that they differ in the point alone."""
    return [Job(f"{number:04d}", POINTS[number].levels, SCREENING_SEED) for number in numbers]


def repeat_points(numbers: Iterable[int], *, seeds: int) -> list[Job]:
    """Return the jobs of these points, each with `seeds` seeds that the screening has not."""
    return [
        Job(f"{number:04d}/{seed}", POINTS[number].levels, seed)
        for number in numbers
        for seed in range(SCREENING_SEED + 1, SCREENING_SEED + 1 + seeds)
    ]


def parse_job_name(name: str) -> tuple[int, int]:
    """Return the number of a job's point, and the seed that it is repeated with; 0 if it is not."""
    number, _, seed = name.partition("/")
    return int(number), int(seed or 0)


def select_finalists(screened: Mapping[str, JobHistory], *, count: int, seeds: int) -> list[Job]:
    """Return the `count` best points of a screening and the paper's optimum, each with `seeds` new seeds.

    Raises InputError if the screening is not complete.
    """
    numbers = dict.fromkeys([*_rank_points(screened)[:count], POINTS.index(OPTIMUM)])
    return repeat_points(numbers, seeds=seeds)


def select_across_ranking(screened: Mapping[str, JobHistory], *, count: int, seeds: int) -> list[Job]:
    """Return `count` points evenly spaced over the ranking of a screening, each with `seeds` new seeds.

    The best points alone, which are alike, do not show whether a screening ranks as a larger budget does.
    Raises InputError if the screening is not complete.
    """
    ranking = _rank_points(screened)
    ranks = np.linspace(0, len(ranking) - 1, min(count, len(ranking))).round().astype(int)
    return repeat_points((ranking[rank] for rank in ranks), seeds=seeds)


def parse_point_numbers(text: str) -> list[int]:
    """Parse numbers of points such as `0-19,380`, sorted and unique. Raises InputError for anything else."""
    numbers: set[int] = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        last = last or first
        if not first.isdigit() or not last.isdigit():
            raise InputError(f"--points {text!r} is not a list of numbers such as 0-19,380")
        if int(last) < int(first):
            raise InputError(f"--points {text!r}: {part} is reversed; write {last}-{first}")
        numbers |= set(range(int(first), int(last) + 1))
    if max(numbers) >= len(POINTS):
        raise InputError(f"--points {text!r} is not within 0-{len(POINTS) - 1}")
    return sorted(numbers)


def _rank_points(screened: Mapping[str, JobHistory]) -> list[int]:
    """Return the numbers of the points, from the lowest to the highest MRE."""
    mre = {name: history.complete.values[0] for name, history in screened.items() if history.complete}
    if len(mre) < len(screened) or not screened:
        raise InputError(
            f"the screening is not complete: {len(screened) - len(mre)} of {len(screened)} points are open; "
            "finish it with sweeps.run first"
        )
    return [parse_job_name(name)[0] for name in sorted(mre, key=lambda name: (mre[name], name))]
