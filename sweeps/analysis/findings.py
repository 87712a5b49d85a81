"""The page of findings: sentences that claim no more than the intervals show."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from laesi_tf.reporting.markdown import format_table
from sweeps.analysis.effects import Effect, EffectModel
from sweeps.analysis.ranking import Finalist, RankCorrelation, RepeatedPoint, rank_of_optimum
from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS

_NOTABLE_SHARE = 0.01
"""Share of the variance, beyond that expected by chance, from which on an interaction is reported."""
_LARGEST_PAIRS = 3
_SEARCH_MARKS = (10, 25, 50, 100, 150, 200)
"""Numbers of trials in the table of searches."""


def notable_interactions(model: EffectModel) -> list[str]:
    """Return the pairs of factors with a significant interaction of notable size, the largest first."""
    significant = {effect.factor for effect in model.pairs if effect.is_significant}
    pairs = [name for name in significant if model.shares[name] - model.by_chance[name] >= _NOTABLE_SHARE]
    return sorted(pairs, key=lambda name: -model.shares[name])


def describe_study(name: str, records: Sequence[TrialRecord], attributes: Mapping[str, Any]) -> str:
    """Return the budget of a study, and how many of its trials are better than a constant guess."""
    if "budget" not in attributes:
        return f"- {name}: its budget is not known."
    budget = (
        "- {name}: {steps} steps of {batch_size} images of {size} px out of {pictures}, validated on "
        "{validation}; Large is MobileNetV3 {large} from {weights_large}, Small from {weights_small}."
    ).format(name=name, **attributes["budget"])
    if "guess_mre" not in attributes:
        return budget
    guess = attributes["guess_mre"]
    below = sum(record.mre < guess for record in records)
    return f"{budget} A constant guess has an MRE of {guess:.1f} %: {below} of {len(records)} are below."


def describe_screening(
    screened: Sequence[TrialRecord], part: Sequence[TrialRecord], model: EffectModel | None
) -> list[str]:
    """Return the section of the screening: errors, effects, interactions, the rank of the optimum.

    The effects of `model` are those of `part`, a full factorial within `screened`; None if it is too small.
    """
    errors = np.array([record.mre for record in screened])
    best = screened[int(np.argmin(errors))]
    return [
        "## Screening",
        "",
        f"{len(screened)} points, {_describe_seeds(screened)}. MRE from {errors.min():.1f} to "
        f"{errors.max():.1f} %, median {np.median(errors):.1f} %. The best is number {best.number} "
        f"({_describe_point(best.number)}); it is the lowest of {len(screened)} and so partly due "
        "to chance.",
        "",
        *_describe_missing(screened, part, model),
        *(_describe_effects(part, model) if model else []),
        *_describe_optimum(screened),
    ]


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
        f"({_describe_point(best.number)}): {best.mre:.1f} %. Of the {len(finalists) - 1} others "
        f"{alike} are not significantly worse."
        + (f" {_count(left_out, 'point')} without a trial for every seed left out." if left_out else ""),
        "",
    ]
    for rank, finalist in enumerate(finalists, 1):
        if finalist.number == POINTS.index(OPTIMUM):
            lines += [
                f"The paper's optimum is {_ordinal(rank)} of {len(finalists)} {_finalist_verdict(finalist)}.",
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
                    _describe_point(f.number),
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


def _describe_missing(
    screened: Sequence[TrialRecord], part: Sequence[TrialRecord], model: EffectModel | None
) -> list[str]:
    """Return what an unfinished screening lacks; empty for a complete one."""
    missing = len(POINTS) - len({record.number for record in screened})
    if not missing and model:
        return []
    lines = [f"Unfinished: {missing} of {len(POINTS)} points are missing."] if missing else []
    if not model:
        lines.append("Effects are not estimated: in the complete part fewer than three factors vary.")
    elif len(part) < len(screened):
        levels = {name: {record.point.levels[name] for record in part} for name in FACTORS}
        removed = [
            f"{name} {level}"
            for name in FACTORS
            for level in dict.fromkeys(record.point.levels[name] for record in screened)
            if level not in levels[name]
        ]
        lines.append(
            f"Effects are estimated on {len(part)} points with all combinations of their levels, without "
            f"{', '.join(removed)}."
        )
    return [*lines, ""]


def _describe_effects(part: Sequence[TrialRecord], model: EffectModel) -> list[str]:
    shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in model.shares.items())
    return [
        f"Of the variance of the logarithm of the MRE: {shares}; residual {100 * model.residual:.1f} %.",
        "",
        "Compared with the average of a factor's levels, in the order of what the factors explain:",
        "",
        *_describe_main_effects(model),
        "",
        *format_table(
            ["factor", "level", "change of the MRE, %", "significant difference from the average"],
            [[e.factor, e.level, _format_interval(e), _effect_verdict(e)] for e in model.main],
        ),
        "",
        *_describe_interactions(model),
        *_format_pair_means(part, model),
    ]


def _describe_main_effects(model: EffectModel) -> list[str]:
    """Return a sentence for each factor, in the order of their shares of the variance."""
    factors = dict.fromkeys(effect.factor for effect in model.main)
    lines = []
    for factor in sorted(factors, key=lambda name: -model.shares[name]):
        effects = sorted((e for e in model.main if e.factor == factor), key=lambda effect: effect.change)
        levels: dict[str, list[str]] = {"better": [], "worse": []}
        for effect in effects:
            if effect.is_significant:
                levels[_effect_verdict(effect)].append(effect.level)
        clauses = [f"{verdict}: {', '.join(names)}" for verdict, names in levels.items() if names]
        if clauses and (partners := _dominating_partners(factor, model)):
            clauses.append(
                f"on average, as the effect depends on the {' and the '.join(partners)}: see the table below"
            )
        lines.append(
            f"- {factor} — {'; '.join(clauses) or 'no level differs significantly from the average'}."
        )
    return lines


def _dominating_partners(factor: str, model: EffectModel) -> list[str]:
    """Return the factors whose interaction with `factor` explains more than `factor` alone."""
    pairs = [
        name.split(" x ") for name in notable_interactions(model) if model.shares[name] > model.shares[factor]
    ]
    return [pair[1 - pair.index(factor)] for pair in pairs if factor in pair]


def _format_pair_means(part: Sequence[TrialRecord], model: EffectModel) -> list[str]:
    """Return a table of errors for each factor that explains less than its interaction with another."""
    factors = {effect.factor for effect in model.main if effect.is_significant}
    pairs = {(factor, other) for factor in factors for other in _dominating_partners(factor, model)}
    lines = []
    for row_factor, column_factor in sorted(pairs):
        logs: dict[tuple[str, str], list[float]] = {}
        for record in part:
            levels = record.point.levels
            logs.setdefault((levels[row_factor], levels[column_factor]), []).append(np.log(record.mre))
        rows, columns = (list(dict.fromkeys(pair[side] for pair in logs)) for side in (0, 1))
        cells = [[row, *(f"{np.exp(np.mean(logs[row, level])):.0f}" for level in columns)] for row in rows]
        lines += [
            f"Geometric mean of the MRE, %, by {row_factor} and {column_factor}:",
            "",
            *format_table([f"{row_factor}, {column_factor}", *columns], cells),
            "",
        ]
    return lines


def _describe_interactions(model: EffectModel) -> list[str]:
    names = notable_interactions(model)
    if not names:
        least = f"{100 * _NOTABLE_SHARE:.0f} %"
        return [f"No interaction of two factors explains {least} of the variance beyond chance.", ""]
    lines = ["Pairs of levels that differ from the sum of their two effects:", ""]
    for name in names:
        significant = [effect for effect in model.pairs if effect.factor == name and effect.is_significant]
        largest = sorted(significant, key=lambda effect: -abs(np.log1p(effect.change / 100)))
        pairs = "; ".join(
            f"{effect.level} {_format_interval(effect)} %" for effect in largest[:_LARGEST_PAIRS]
        )
        lines.append(f"- {name} ({100 * model.shares[name]:.1f} % of the variance): {pairs}")
    return [*lines, ""]


def _describe_optimum(records: Sequence[TrialRecord]) -> list[str]:
    if POINTS.index(OPTIMUM) not in {record.number for record in records}:
        return []
    rank, count = rank_of_optimum(records)
    return [
        f"The paper's optimum ({_describe_point(POINTS.index(OPTIMUM))}) is {_ordinal(rank)} of {count}: "
        f"{100 * (rank - 1) / count:.0f} % of the points are better. It is one trial with one seed: its rank "
        "has no interval.",
        "",
    ]


def _describe_correlation(correlation: RankCorrelation) -> str:
    verdict = ""
    if correlation.high < 0:
        verdict = "; they rank in opposite order"
    elif correlation.low <= 0:
        verdict = "; not significantly different from zero"
    interval = f"{correlation.value:.2f} [{correlation.low:.2f}, {correlation.high:.2f}]"
    return f"{correlation.name} between the two budgets: {interval}{verdict}."


def _describe_seeds(records: Sequence[TrialRecord]) -> str:
    seeds = [record.seed for record in records]
    changed = sum(seed != min(seeds) for seed in seeds)
    return f"one seed except {changed} that diverged with it" if changed else "one seed"


def _describe_point(number: int) -> str:
    return ", ".join(POINTS[number].levels.values())


def _effect_verdict(effect: Effect) -> str:
    return "" if not effect.is_significant else "better" if effect.high < 0 else "worse"


def _finalist_verdict(finalist: Finalist) -> str:
    if not finalist.behind:
        return f"with {finalist.mre:.1f} %"
    verdict = "not significantly worse" if finalist.low <= 0 else "significantly worse"
    return f"with {finalist.mre:.1f} %, {verdict} than the best: {_format_difference(finalist)} %"


def _format_difference(finalist: Finalist) -> str:
    if not finalist.behind:
        return "the best"
    return f"{finalist.behind:+.1f} [{finalist.low:+.1f}, {finalist.high:+.1f}]"


def _format_interval(effect: Effect) -> str:
    return f"{effect.change:+.1f} [{effect.low:+.1f}, {effect.high:+.1f}]"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
