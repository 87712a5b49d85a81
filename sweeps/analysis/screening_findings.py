"""The findings of the screening: its errors, the effects of the factors, the rank of the paper's optimum."""

from collections.abc import Sequence

import numpy as np

from laesi_tf.common.text import format_ordinal
from laesi_tf.reporting.markdown import format_table
from sweeps.analysis.effects import Effect, EffectModel
from sweeps.analysis.ranking import rank_of_optimum
from sweeps.analysis.trial_table import TrialRecord
from sweeps.trials.search_space import FACTORS, OPTIMUM, POINTS

_NOTABLE_SHARE = 0.01
"""Share of the variance, beyond that expected by chance, from which on an interaction is reported."""
_LARGEST_PAIRS = 3


def notable_interactions(model: EffectModel) -> list[str]:
    """Return the pairs of factors with a significant interaction of notable size, the largest first."""
    significant = {effect.factor for effect in model.pairs if effect.is_significant}
    pairs = [name for name in significant if model.shares[name] - model.by_chance[name] >= _NOTABLE_SHARE]
    return sorted(pairs, key=lambda name: -model.shares[name])


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
        f"({POINTS[best.number]}); it is the lowest of {len(screened)} and so partly due "
        "to chance.",
        "",
        *_describe_missing(screened, part, model),
        *(_describe_effects(part, model) if model else []),
        *_describe_optimum(screened),
    ]


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
        f"The paper's optimum ({OPTIMUM}) is {format_ordinal(rank)} of {count}: "
        f"{100 * (rank - 1) / count:.0f} % of the points are better. It is one trial with one seed: its rank "
        "has no interval.",
        "",
    ]


def _describe_seeds(records: Sequence[TrialRecord]) -> str:
    seeds = [record.seed for record in records]
    changed = sum(seed != min(seeds) for seed in seeds)
    return f"one seed except {changed} that diverged with it" if changed else "one seed"


def _effect_verdict(effect: Effect) -> str:
    return "" if not effect.is_significant else "better" if effect.high < 0 else "worse"


def _format_interval(effect: Effect) -> str:
    return f"{effect.change:+.1f} [{effect.low:+.1f}, {effect.high:+.1f}]"
