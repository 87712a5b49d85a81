"""Select the jobs of a study: points of the grid, or some of them again with several seeds."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from laesi_tf.common.errors import InputError
from sweeps.queue.grid_queue import JobHistory
from sweeps.queue.trial_queue import Job
from sweeps.trials.search_space import OPTIMUM, POINTS

SCREENING_SEED = 0


def select_points(chosen: Sequence[int]) -> list[Job]:
    """The points of these numbers, all with one seed: what they differ in is then the point alone."""
    return [Job(f"{number:04d}", POINTS[number].levels, SCREENING_SEED) for number in chosen]


def select_finalists(screened: Mapping[str, JobHistory], *, count: int, seeds: int) -> list[Job]:
    """The `count` best of a screening and the paper's optimum, each with `seeds` seeds not used before.

    Raises InputError if the screening is not complete.
    """
    names = dict.fromkeys([*_rank_points(screened)[:count], f"{POINTS.index(OPTIMUM):04d}"])
    return _repeat_with_seeds(names, seeds)


def select_across_ranking(screened: Mapping[str, JobHistory], *, count: int, seeds: int) -> list[Job]:
    """`count` points from the best to the worst of a screening, evenly over its ranking; else as finalists.

    Whether a screening ranks as a larger budget does cannot be seen from its best alone, which are alike.
    """
    ranking = _rank_points(screened)
    places = np.linspace(0, len(ranking) - 1, min(count, len(ranking))).round().astype(int)
    return _repeat_with_seeds((ranking[place] for place in places), seeds)


def parse_point_numbers(text: str) -> list[int]:
    """Parse `0-19,380` as numbers of points. Raises InputError for what is none."""
    found: set[int] = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        if not first.isdigit() or not (last or first).isdigit():
            raise InputError(f"--points {text!r} is not numbers like 0-19,380")
        found |= set(range(int(first), int(last or first) + 1))
    if not found or max(found) >= len(POINTS):
        raise InputError(f"--points {text!r} is not within 0-{len(POINTS) - 1}")
    return sorted(found)


def _rank_points(screened: Mapping[str, JobHistory]) -> list[str]:
    """The names of the points, the best first."""
    open_ones = [name for name, standing in screened.items() if not standing.complete]
    if not screened or open_ones:
        raise InputError(
            f"the screening is not complete: {len(open_ones)} of {len(screened)} points are open"
        )
    mre = {name: standing.complete.values[0] for name, standing in screened.items() if standing.complete}
    return sorted(mre, key=lambda name: (mre[name], name))


def _repeat_with_seeds(names: Iterable[str], seeds: int) -> list[Job]:
    return [
        Job(f"{name}/{seed}", POINTS[int(name)].levels, seed)
        for name in names
        for seed in range(SCREENING_SEED + 1, SCREENING_SEED + 1 + seeds)
    ]
