"""Which jobs a study has: the points of the grid, or some of them again with several seeds."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from laesi_tf.errors import InputError
from sweeps.book import Job
from sweeps.budget import Budget
from sweeps.grid import OPTIMUM, POINTS, Point
from sweeps.ledger import Standing

SCREENING_SEED = 0


def screening(chosen: Sequence[int]) -> list[Job]:
    """The points of these numbers, all with one seed: what they differ in is then the point alone."""
    return [Job(f"{number:04d}", POINTS[number].levels, SCREENING_SEED) for number in chosen]


def finalists(screened: Mapping[str, Standing], *, count: int, seeds: int) -> list[Job]:
    """The `count` best of a screening and the paper's optimum, each with `seeds` seeds not used before.

    Raises InputError if the screening is not complete.
    """
    names = dict.fromkeys([*_ranking(screened)[:count], f"{POINTS.index(OPTIMUM):04d}"])
    return _again(names, seeds)


def spread(screened: Mapping[str, Standing], *, count: int, seeds: int) -> list[Job]:
    """`count` points from the best to the worst of a screening, evenly over its ranking; else as finalists.

    Whether a screening ranks as a larger budget does cannot be seen from its best alone, which are alike.
    """
    ranking = _ranking(screened)
    places = np.linspace(0, len(ranking) - 1, min(count, len(ranking))).round().astype(int)
    return _again((ranking[place] for place in places), seeds)


def numbers(text: str) -> list[int]:
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


def _ranking(screened: Mapping[str, Standing]) -> list[str]:
    """The names of the points, the best first."""
    open_ones = [name for name, standing in screened.items() if not standing.complete]
    if not screened or open_ones:
        raise InputError(
            f"the screening is not complete: {len(open_ones)} of {len(screened)} points are open"
        )
    mre = {name: standing.complete.values[0] for name, standing in screened.items() if standing.complete}
    return sorted(mre, key=lambda name: (mre[name], name))


def _again(names: Iterable[str], seeds: int) -> list[Job]:
    return [
        Job(f"{name}/{seed}", POINTS[int(name)].levels, seed)
        for name in names
        for seed in range(SCREENING_SEED + 1, SCREENING_SEED + 1 + seeds)
    ]


def backbone(job: Job, budget: Budget) -> str:
    """The kind of network that a job trains."""
    return budget.config(Point(**job.levels), job.seed).backbone
