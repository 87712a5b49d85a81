"""The points of the reference, its budget, and the candidates for the screening."""

import itertools
from collections import Counter
from dataclasses import replace
from pathlib import Path

from sweeps.trials.budget import Budget
from sweeps.trials.search_space import OPTIMUM, POINTS

REFERENCE = Budget(size=128, steps=2000, pictures=8192, validation=512, calibration=512)
"""Long enough that what a training settles at shows. Its scenes are those of the shipped area network: on
`phone`, whose views are 30 to 600 mm wide, an area network learns too little to rank (an MRE of 46 % after
3,500 steps at 224 px)."""
BEFORE = "as_before"
MOST_COST = 1.25
"""CPU time of a trial of the screening over that of BEFORE, at most. Relative, as the CPU time of the same
trial doubles where other work shares the core."""

_SCENES = Path(__file__).parent.parent / "scenes"
_FIXED_SCALE, _CLOSE = (str(_SCENES / f"{name}.toml") for name in ("fixed_scale", "close"))
_BEFORE = Budget(ranges="rendering_2", size=64, batch_size=32, steps=80, pictures=4096)
"""The screening of 2026-11-25, written out: it must not change with the one that is chosen."""
CANDIDATES: dict[str, Budget] = {
    BEFORE: _BEFORE,
    # A step costs in proportion to its pixels.
    "small_images": replace(_BEFORE, size=48, steps=142),
    # A millimetre has one to three pixels, so that the ruling, and with it the scale, can be seen.
    "close": replace(_BEFORE, ranges=_CLOSE, size=96, steps=36),
    # The scale need not be read: what remains to be learnt is the silhouette.
    "fixed_scale": replace(_BEFORE, ranges=_FIXED_SCALE),
    "silhouettes_first": replace(_BEFORE, silhouette_steps=30),
    "large_batches": replace(_BEFORE, batch_size=128, steps=20),
    "few_pictures": replace(_BEFORE, pictures=512),
    "warm_start": replace(_BEFORE, warm_start_steps=80),
    "fixed_scale_small_images": replace(_BEFORE, ranges=_FIXED_SCALE, size=48, steps=142),
    "fixed_scale_warm_start": replace(_BEFORE, ranges=_FIXED_SCALE, warm_start_steps=80),
}
"""About as expensive as that screening, each with one change, and two with two."""


def adapt_candidate(candidate: Budget, reference: Budget) -> Budget:
    """Return `candidate` with the networks of `reference`, and its scenes unless it has its own."""
    names = ("alpha", "large", "weights_large", "weights_small")
    ranges = reference.ranges if candidate.ranges == _BEFORE.ranges else candidate.ranges
    return replace(candidate, ranges=ranges, **{name: getattr(reference, name) for name in names})


def spread_points(count: int) -> list[int]:
    """Return the numbers of `count` points that are spread evenly over the grid's factors, sorted.

    The first is the paper's optimum. Each next one is the point whose levels, alone and in pairs, have
    occurred the least among those before; of equal ones the first in an order that visits the grid in steps.
    """
    # A stride without a common factor with 1,425 visits every point; neighbours differ in all factors.
    order = [(number * 577) % len(POINTS) for number in range(len(POINTS))]
    used: Counter[tuple[tuple[str, str], ...]] = Counter()
    chosen: list[int] = []
    number = POINTS.index(OPTIMUM)
    while len(chosen) < min(count, len(POINTS)):
        chosen.append(number)
        used.update(_combinations(number))
        free = (other for other in order if other not in chosen)
        number = min(free, key=lambda other: _overlap(other, used), default=number)
    return sorted(chosen)


def _overlap(number: int, used: Counter[tuple[tuple[str, str], ...]]) -> float:
    """Return how often the levels of a point, and their pairs, have been used."""
    # A level counts as much as a pair of it with each other factor, and is repeated far more often.
    return sum(used[combination] for combination in _combinations(number))


def _combinations(number: int) -> list[tuple[tuple[str, str], ...]]:
    levels = list(POINTS[number].levels.items())
    return [(level,) for level in levels] + list(itertools.combinations(levels, 2))
