"""The page of findings: sentences that say no more than the intervals do."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from laesi_tf.reporting.markdown import format_table
from sweeps.analysis.effects import Effect, EffectModel
from sweeps.analysis.ranking import (
    Finalist,
    RankCorrelation,
    RepeatedPoint,
    rank_correlations,
    rank_of_optimum,
)
from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import OPTIMUM, POINTS

_NOTABLE_SHARE = 0.01
"""Share of the variance, beyond that by chance, from which on an interaction is told."""


def notable_interactions(fitted: EffectModel) -> list[str]:
    """The pairs of factors whose interaction matters, the largest first: by its share beyond chance, and told
    apart somewhere."""
    told = {effect.factor for effect in fitted.pairs if effect.is_told_apart}
    pairs = [name for name in told if fitted.shares[name] - fitted.by_chance[name] >= _NOTABLE_SHARE]
    return sorted(pairs, key=lambda name: -fitted.shares[name])


def describe_study(name: str, rows: Sequence[TrialRecord], about: Mapping[str, Any]) -> str:
    """What a trial of a study could spend, and how many learned anything, from what it keeps about itself."""
    if "budget" not in about:
        return f"- {name}: its budget is not known."
    spent = (
        "- {name}: {steps} steps of {batch_size} pictures of {size} px out of {pictures}, judged on "
        "{validation}; Large is MobileNetV3 {large} from {weights_large}, Small from {weights_small}."
    ).format(name=name, **about["budget"])
    if "guess_mre" not in about:
        return spent
    guess = about["guess_mre"]
    below = sum(row.mre < guess for row in rows)
    return (
        f"{spent} One guess for all pictures gives an MRE of {guess:.1f} %: {below} of {len(rows)} are below."
    )


def describe_screening(rows: Sequence[TrialRecord], fitted: EffectModel) -> list[str]:
    """What the screening says: shares, main effects, interactions, the place of the optimum."""
    errors = np.array([row.mre for row in rows])
    best = rows[int(np.argmin(errors))]
    shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in fitted.shares.items())
    return [
        "## Screening",
        "",
        f"{len(rows)} points, {_describe_seeds(rows)}. MRE from {errors.min():.1f} to {errors.max():.1f} %, "
        f"median {np.median(errors):.1f} %. The best is number {best.number} ({_describe_point(best.number)}); "
        f"being the lowest of {len(rows)}, it is so in part by luck.",
        "",
        f"Of the variance of the logarithm of the MRE: {shares}; left over {100 * fitted.residual:.1f} %.",
        "",
        "Compared with the average of a factor's levels, in the order of what the factors explain:",
        "",
        *_describe_main_effects(fitted),
        "",
        *format_table(
            ["factor", "level", "change of the MRE, %", "told apart from the average"],
            [[e.factor, e.level, _format_interval(e), _effect_verdict(e)] for e in fitted.main],
        ),
        *_describe_interactions(fitted),
        *_format_pair_means(rows, fitted),
        *_describe_optimum(rows),
    ]


def describe_finalists(found: Sequence[Finalist], seeds: int, left_out: int = 0) -> list[str]:
    """What the larger budget says: who is best, who cannot be told from it, whether the ranks agree.

    `left_out` are points that were not tried with all `seeds`.
    """
    best, alike = found[0], sum(final.low <= 0 for final in found[1:])
    lines = [
        "## Finalists",
        "",
        f"{len(found)} points at the larger budget, {_count(seeds, 'seed')} each; the MRE is the geometric "
        f"mean over them. The lowest is that of number {best.number} ({_describe_point(best.number)}): "
        f"{best.mre:.1f} %. Of the {len(found) - 1} others {alike} cannot be told from it."
        + (f" {_count(left_out, 'point')} not tried with every seed yet left out." if left_out else ""),
        "",
    ]
    for place, final in enumerate(found, 1):
        if final.number == POINTS.index(OPTIMUM):
            lines += [
                f"The paper's optimum comes {_ordinal(place)} of {len(found)} {_finalist_verdict(final)}.",
                "",
            ]
    return [
        *lines,
        *(_describe_correlation(one) for one in rank_correlations(found)),
        "All but the optimum are the best of the screening: over so narrow a range ranks may agree less than",
        "over the whole grid.",
        "",
        *format_table(
            ["number", "point", "screening MRE %", "MRE %", "behind the best, %"],
            [
                [
                    f.number,
                    _describe_point(f.number),
                    f"{f.screened:.1f}",
                    f"{f.mre:.1f}",
                    _format_difference(f),
                ]
                for f in found
            ],
        ),
    ]


def describe_repeats(found: Sequence[RepeatedPoint], seeds: int) -> list[str]:
    """Whether the two budgets rank alike from the best to the worst."""
    return [
        "## From best to worst",
        "",
        f"{len(found)} points spread evenly over the ranking of the screening were tried again at the larger "
        f"budget, with {_count(seeds, 'seed')} each.",
        "",
        *(_describe_correlation(one) for one in rank_correlations(found)),
        "",
    ]


def describe_search_cost(
    random: np.ndarray, tpe: np.ndarray, went: tuple[np.ndarray, np.ndarray] | None, steps: int
) -> list[str]:
    """What the searches found for what they spent; the arguments are those of `charts.spending`."""
    count = random.shape[1]
    middle = np.median(tpe, axis=0)
    marks = [spent for spent in (10, 25, 50, 100, 150, 200) if spent <= count]
    better = 100 * np.mean(tpe[:, -1] < random[1, -1])
    lines = [
        "## Searching",
        "",
        *format_table(
            ["trials spent", "lowest MRE %, grid in random order", "lowest MRE %, TPE replayed on the grid"],
            [[spent, f"{random[1, spent - 1]:.1f}", f"{middle[spent - 1]:.1f}"] for spent in marks],
        ),
        f"Medians over orders and {len(tpe)} replays. After {count} trials {better:.0f} % of the replays are",
        "below the median of the random order.",
        "",
    ]
    if went is not None:
        spent, lowest = went
        lines += [
            f"The one run with pruning made {len(spent)} trials with the steps of {spent[-1] / steps:.0f}",
            f"whole ones and reached {lowest[-1]:.1f} %.",
            "",
        ]
    return lines


def _describe_main_effects(fitted: EffectModel) -> list[str]:
    """A sentence for each factor, that of the largest share first."""
    factors = dict.fromkeys(effect.factor for effect in fitted.main)
    lines = []
    for factor in sorted(factors, key=lambda name: -fitted.shares[name]):
        effects = sorted((e for e in fitted.main if e.factor == factor), key=lambda effect: effect.change)
        sorts: dict[str, list[str]] = {"better": [], "worse": []}
        for effect in effects:
            if effect.is_told_apart:
                sorts[_effect_verdict(effect)].append(effect.level)
        told = [f"{sort}: {', '.join(levels)}" for sort, levels in sorts.items() if levels]
        if told and (others := _dominating_partners(factor, fitted)):
            told.append(f"on average, for it hangs on the {' and the '.join(others)}: see the table below")
        lines.append(f"- {factor} — {'; '.join(told) or 'no level can be told from the average'}.")
    return lines


def _dominating_partners(factor: str, fitted: EffectModel) -> list[str]:
    """The other factors with which this one explains more than alone."""
    pairs = [
        name.split(" x ")
        for name in notable_interactions(fitted)
        if fitted.shares[name] > fitted.shares[factor]
    ]
    return [pair[1 - pair.index(factor)] for pair in pairs if factor in pair]


def _format_pair_means(rows: Sequence[TrialRecord], fitted: EffectModel) -> list[str]:
    """Where a factor explains less than its pair with another, the error of each pair of levels."""
    told = {effect.factor for effect in fitted.main if effect.is_told_apart}
    pairs = {(factor, other) for factor in told for other in _dominating_partners(factor, fitted)}
    lines = []
    for down, across in sorted(pairs):
        logs: dict[tuple[str, str], list[float]] = {}
        for row in rows:
            logs.setdefault((row.point.levels[down], row.point.levels[across]), []).append(np.log(row.mre))
        header, names = (list(dict.fromkeys(pair[side] for pair in logs)) for side in (1, 0))
        cells = [[name, *(f"{np.exp(np.mean(logs[name, level])):.0f}" for level in header)] for name in names]
        lines += [
            f"Geometric mean of the MRE, %, by {down} and {across}:",
            "",
            *format_table([f"{down}, {across}", *header], cells),
        ]
    return lines


def _describe_seeds(rows: Sequence[TrialRecord]) -> str:
    seeds = [row.seed for row in rows]
    moved = sum(seed != min(seeds) for seed in seeds)
    return "one seed" if not moved else f"one seed but for {moved} that diverged with it"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _describe_interactions(fitted: EffectModel) -> list[str]:
    names = notable_interactions(fitted)
    if not names:
        least = f"{100 * _NOTABLE_SHARE:.0f} %"
        return [f"No pair of factors explains {least} of the variance beyond its two effects.", ""]
    lines = ["Pairs that do more, or less, than their two effects together:", ""]
    for name in names:
        told = [effect for effect in fitted.pairs if effect.factor == name and effect.is_told_apart]
        largest = sorted(told, key=lambda effect: -abs(np.log1p(effect.change / 100)))[:3]
        shown = "; ".join(f"{effect.level} {_format_interval(effect)} %" for effect in largest)
        share = f"{name} ({100 * fitted.shares[name]:.1f} % of the variance)"
        lines.append(f"- {share}: {shown or 'no single pair is told apart'}")
    return [*lines, ""]


def _describe_optimum(rows: Sequence[TrialRecord]) -> list[str]:
    if POINTS.index(OPTIMUM) not in {row.number for row in rows}:
        return []
    place, of = rank_of_optimum(rows)
    return [
        f"The paper's optimum ({_describe_point(POINTS.index(OPTIMUM))}) comes {_ordinal(place)} of {of}: "
        f"{100 * (place - 1) / of:.0f} % of the points are better. It is one trial with one seed: its place "
        "has no interval.",
        "",
    ]


def _describe_correlation(one: RankCorrelation) -> str:
    if one.low > 0:
        verdict = ""
    elif one.high < 0:
        verdict = "; they rank in opposite order"
    else:
        verdict = "; the interval holds zero, so no agreement is shown"
    return f"{one.name} between the two budgets: {one.value:.2f} [{one.low:.2f}, {one.high:.2f}]{verdict}."


def _effect_verdict(effect: Effect) -> str:
    return "" if not effect.is_told_apart else "better" if effect.high < 0 else "worse"


def _finalist_verdict(final: Finalist) -> str:
    if not final.behind:
        return f"with {final.mre:.1f} %"
    verdict = "cannot be told from the best" if final.low <= 0 else "is behind the best"
    return f"with {final.mre:.1f} % and {verdict}: {_format_difference(final)} %"


def _format_difference(final: Finalist) -> str:
    if not final.behind:
        return "the best"
    return f"{final.behind:+.1f} [{final.low:+.1f}, {final.high:+.1f}]"


def _format_interval(effect: Effect) -> str:
    return f"{effect.change:+.1f} [{effect.low:+.1f}, {effect.high:+.1f}]"


def _describe_point(number: int) -> str:
    return ", ".join(POINTS[number].levels.values())


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
