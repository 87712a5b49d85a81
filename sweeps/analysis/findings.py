"""The findings of finalists, repeated points and searches, no stronger than their intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from laesi_tf.common.text import format_ordinal
from laesi_tf.reporting.markdown import format_table
from sweeps.analysis.ranking import Finalist, RankCorrelation, RepeatedPoint
from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import OPTIMUM, POINTS

_SEARCH_MARKS = (10, 25, 50, 100, 150, 200)
"""Numbers of trials in the table of searches."""


def describe_study(name: str, records: Sequence[TrialRecord], attributes: Mapping[str, Any]) -> str:
    """Return the budget of a study, and how many of its trials are better than a constant guess."""
    if "budget" not in attributes:
        return f"- {name}: its budget is not known."
    budget = (
        "- {name}: {steps} steps of {batch_size} images of {size} px out of {pictures}{scenes}, validated on "
        "{validation}; Large is MobileNetV3 {large} from {weights_large}, Small from {weights_small}."
    ).format(name=name, scenes=_describe_scenes(attributes["budget"]), **attributes["budget"])
    if "guess_mre" not in attributes:
        return budget
    guess = attributes["guess_mre"]
    below = sum(record.mre < guess for record in records)
    return f"{budget} A constant guess has an MRE of {guess:.1f} %: {below} of {len(records)} are below."


def _describe_scenes(budget: Mapping[str, Any]) -> str:
    """Return " of SCENES", or nothing for a study of before budgets named their scenes."""
    return f" of {budget['ranges']}" if "ranges" in budget else ""


def describe_finalists(
    finalists: Sequence[Finalist],
    correlations: Sequence[RankCorrelation],
    seeds: int,
    left_out: int = 0,
) -> list[str]:
    """Return the section of the finalists: the best, who is significantly worse, whether the ranks agree.

    `left_out` points were not repeated with all `seeds`.
    """
    best, alike = finalists[0], sum(finalist.low <= 0 for finalist in finalists[1:])
    lines = [
        "## Finalists",
        "",
        f"{len(finalists)} points at the larger budget, {_count(seeds, 'seed')} each; the MRE is the "
        f"geometric mean over seeds. The lowest is that of number {best.number} "
        f"({POINTS[best.number]}): {best.mre:.1f} %. Of the {len(finalists) - 1} others "
        f"{alike} are not significantly worse."
        + (f" {_count(left_out, 'point')} without a trial for every seed left out." if left_out else ""),
        "",
    ]
    for rank, finalist in enumerate(finalists, 1):
        if finalist.number == POINTS.index(OPTIMUM):
            lines += [
                f"The paper's optimum is {format_ordinal(rank)} of {len(finalists)} "
                f"{_finalist_verdict(finalist)}.",
                "",
            ]
    return [
        *lines,
        *map(_describe_correlation, correlations),
        "All but the optimum are the best of the screening: over such a narrow range ranks may agree less",
        "than over the whole grid.",
        "",
        *format_table(
            ["number", "point", "screening MRE %", "MRE %", "worse than the best by, %"],
            [
                [
                    f.number,
                    POINTS[f.number],
                    f"{f.screened:.1f}",
                    f"{f.mre:.1f}",
                    _format_difference(f),
                ]
                for f in finalists
            ],
        ),
        "",
    ]


def describe_repeats(
    points: Sequence[RepeatedPoint], correlations: Sequence[RankCorrelation], seeds: int
) -> list[str]:
    """Return the section on points from the whole ranking: whether the two budgets rank alike."""
    return [
        "## From best to worst",
        "",
        f"{len(points)} points, evenly spaced over the ranking of the screening, were repeated at the larger "
        f"budget, with {_count(seeds, 'seed')} each.",
        "",
        *map(_describe_correlation, correlations),
        "",
    ]


def describe_search_cost(
    random: np.ndarray, tpe: np.ndarray, pruned: tuple[np.ndarray, np.ndarray] | None, steps: int
) -> list[str]:
    """Return the section of the searches: their lowest error against their cost.

    The arguments are those of `charts.plot_search_cost`.
    """
    count = random.shape[1]
    median = np.median(tpe, axis=0)
    marks = [trials for trials in _SEARCH_MARKS if trials <= count]
    better = 100 * np.mean(tpe[:, -1] < random[1, -1])
    lines = [
        "## Searching",
        "",
        *format_table(
            ["trials", "lowest MRE %, grid in random order", "lowest MRE %, TPE replayed on the grid"],
            [[trials, f"{random[1, trials - 1]:.1f}", f"{median[trials - 1]:.1f}"] for trials in marks],
        ),
        "",
        f"Medians over orders and {len(tpe)} replays. After {count} trials {better:.0f} % of the replays are",
        "below the median of the random order.",
        "",
    ]
    if pruned is not None:
        spent, lowest = pruned
        lines += [
            f"The one run with pruning made {len(spent)} trials with the steps of {spent[-1] / steps:.0f}",
            f"complete ones and reached {lowest[-1]:.1f} %.",
            "",
        ]
    return lines


def _describe_correlation(correlation: RankCorrelation) -> str:
    verdict = ""
    if correlation.high < 0:
        verdict = "; they rank in opposite order"
    elif correlation.low <= 0:
        verdict = "; not significantly different from zero"
    interval = f"{correlation.value:.2f} [{correlation.low:.2f}, {correlation.high:.2f}]"
    return f"{correlation.name} between the two budgets: {interval}{verdict}."


def _finalist_verdict(finalist: Finalist) -> str:
    if not finalist.behind:
        return f"with {finalist.mre:.1f} %"
    verdict = "not significantly worse" if finalist.low <= 0 else "significantly worse"
    return f"with {finalist.mre:.1f} %, {verdict} than the best: {_format_difference(finalist)} %"


def _format_difference(finalist: Finalist) -> str:
    if not finalist.behind:
        return "the best"
    return f"{finalist.behind:+.1f} [{finalist.low:+.1f}, {finalist.high:+.1f}]"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
