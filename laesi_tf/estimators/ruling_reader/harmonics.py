"""The harmonic score of a ruling, and which of its harmonics belongs to the finest family of lines."""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling_reader.lattice import lattice_frequencies, rate, rates, rescale
from laesi_tf.estimators.ruling_reader.spectra import BINS, COLUMNS, Spectra, compute_prominences

HARMONICS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 2.0, 5.0)
_GAPS = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95)
_FACTORS = (*HARMONICS, *_GAPS, 1.1, 1.2)
FAMILY_FACTORS = (0.1, 0.2, 0.5, *(10 / tooth for tooth in range(1, 11)))
"""How much finer than the lines that were followed the finest may be: these were any tooth of the comb."""
_SQUARE = 1.15
"""Ratio of scales along and across a sheet that tilt may cause in the middle of the picture."""
_STEEPEST = 0.4
"""Change of scale from the middle to the border that a fit may claim: twice that of a tilt of 20 degrees."""
_ALIKE = 0.02
"""Families whose scales differ by less are one."""
_ROUGH, _WRONG = 0.1, 0.008
"""Error of a rough scale, a standard deviation of its logarithm; and the likelihood, relative to that of a
perfect one, that is left to any other: a rough scale is off by far now and then, and the comb may overrule
it."""
MILLIMETRES = np.array([0.5, 1.7, 0.53, -1.39, -0.51, -2.21, 0.21, 0.74, -1.54], np.float32)
"""Weights of the signs of `_signs` on paper whose every fifth or tenth line is heavier: log-odds.

Multinomial logistic regression, as of a choice among all candidates, on 260 scenes of `rendering_2` (seed
11, 768 x 768 and 1536 x 1152) without a rough scale. The choice's softmax is then the chance that a family
is right. Checked on 300 other scenes (seed 12, three sizes): of 292 readings without a rough scale 23 had a
chance below 0.9, on average 0.82, and of 296 with one 9, on average 0.73; one of all these was off by more
than 1 %, with a chance of 0.6.
"""
PLAIN = np.array([1.0, -0.5, 0.5, -1.0, -2.0, -2.0, 1.0, 1.0, -1.5], np.float32)
"""The same for squared paper, where heavier lines are rare, by hand."""
_ANGLES = np.deg2rad(np.arange(0, 180, 1.0))
_STEP = 0.02
_FREQUENCIES = np.exp(np.arange(math.log(1 / 80), math.log(0.46), _STEP))


def find_seeds(spectra: Spectra, stride: int) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """The best untilted lattice of every `stride`-th patch: lattices [n, 6], patches' centres [n, 2],
    scores [n]."""
    chosen = compute_prominences(spectra, stride)
    table = _polar_bins()
    polar = tf.gather(tf.reshape(chosen, [chosen.shape[0], -1]), table.ravel(), axis=1)
    polar = tf.reshape(polar, [-1, *table.shape])
    both = polar[:, : table.shape[0] // 2] + polar[:, table.shape[0] // 2 :]
    score = _combine({factor: _stretch(both, factor) for factor in HARMONICS})
    flat = tf.reshape(score, [score.shape[0], -1])
    best = tf.argmax(flat, axis=1, output_type=tf.int32)
    angle = tf.gather(_ANGLES.astype(np.float32), best // len(_FREQUENCIES))
    along = (
        tf.gather(_FREQUENCIES.astype(np.float32), best % len(_FREQUENCIES)) * BINS / spectra.bins[::stride]
    )
    a, b = along * tf.cos(angle), along * tf.sin(angle)
    none = tf.zeros_like(a)
    return tf.stack([a, b, -b, a, none, none], axis=1), spectra.centres[::stride], tf.reduce_max(flat, axis=1)


def _combine(values: dict[float, tf.Tensor]) -> tf.Tensor:
    """Weigh the comb's prominences: fine lines, and behind every fifth or every tenth a heavier one.

    Lines at odd tenths speak against every fifth being heavier, and for every tenth.
    """
    even, odd = _mean_even_and_odd(values)
    return values[1.0] + 1.5 * tf.maximum(even - 0.5 * odd, (4 * even + 5 * odd) / 9) + 0.25 * values[2.0]


def _polar_bins() -> np.ndarray:
    """Flat index [angles, frequencies] of the bin that lies in each direction at each frequency."""
    place = np.stack(
        [np.outer(np.cos(_ANGLES), _FREQUENCIES), np.outer(np.sin(_ANGLES), _FREQUENCIES)], axis=-1
    )
    place *= np.where(place[..., :1] < 0, -BINS, BINS)
    column, row = np.moveaxis(np.round(place).astype(np.int32), -1, 0)
    return row % BINS * COLUMNS + column


def _stretch(polar: tf.Tensor, factor: float) -> tf.Tensor:
    """`polar` [..., frequencies] read at `factor` times each frequency, zero outside the range."""
    shift = round(math.log(factor) / _STEP)
    if shift >= 0:
        return tf.pad(polar[..., shift:], [[0, 0], [0, 0], [0, shift]])
    return tf.pad(polar[..., :shift], [[0, 0], [0, 0], [-shift, 0]])


def score_families(spectra: Spectra, lattice: tf.Tensor, weights: tf.Tensor) -> tf.Tensor:
    """What speaks for the lines of lattices [B, 6] being the finest, log-odds [B, 2] for both directions.

    `weights` [9] are those of the signs.
    """
    places = (
        lattice_frequencies(lattice, spectra.centres)[..., None, :] * np.array(_FACTORS, np.float32)[:, None]
    )
    means = _mean_over_patches(spectra, places)
    loud, prominent, heard = (dict(zip(_FACTORS, tf.unstack(part, axis=-1), strict=True)) for part in means)
    return tf.reduce_sum(tf.stack(_compute_features(loud, prominent, heard), axis=-1) * weights, axis=-1)


def _compute_features(
    loud: dict[float, tf.Tensor], prominent: dict[float, tf.Tensor], heard: dict[float, tf.Tensor]
) -> list[tf.Tensor]:
    """Signs for and against a family being the finest, each [B, 2].

    The finest lines stand out, with a comb of heavier ones behind them, and their second harmonic; they are
    louder than their second or fifth harmonic, and no tooth at one half rises over its neighbours: there only
    every tenth line could be heard. They rise over the neighbouring teeth, which are heavier lines' harmonics
    alone; and between the teeth there is nothing.
    """
    even, odd = _mean_even_and_odd(prominent)
    comb = tf.maximum(even - 0.5 * odd, (4 * even + 5 * odd) / 9)
    halves = heard[0.4] * heard[0.5] * heard[0.6]
    return [
        prominent[1.0],
        comb,
        prominent[2.0],
        tf.nn.relu(loud[2.0] - loud[1.0]) * heard[2.0],
        tf.nn.relu(loud[5.0] - loud[1.0]) * heard[5.0],
        tf.nn.relu(loud[0.5] - tf.maximum(loud[0.4], loud[0.6])) * halves,
        _compute_rise(loud, heard, 0.8, 1.2),
        _compute_rise(loud, heard, 0.9, 1.1),
        tf.add_n([prominent[gap] for gap in _GAPS]) / len(_GAPS),
    ]


def _mean_even_and_odd(values: dict[float, tf.Tensor]) -> tuple[tf.Tensor, tf.Tensor]:
    """Means of the teeth that lines at every fifth and, beside them, lines at every tenth make."""
    even = (values[0.2] + values[0.4] + values[0.6] + values[0.8]) / 4
    odd = (values[0.1] + values[0.3] + values[0.5] + values[0.7] + values[0.9]) / 5
    return even, odd


def _compute_rise(
    loud: dict[float, tf.Tensor], heard: dict[float, tf.Tensor], before: float, after: float
) -> tf.Tensor:
    """Log-power of the finest lines over the teeth `before` and `after` them, within -3..3."""
    beyond = tf.where(heard[after] > 0, loud[after], loud[before])
    return tf.clip_by_value(loud[1.0] - tf.maximum(loud[before], beyond), -3, 3) * heard[before]


def _mean_over_patches(spectra: Spectra, places: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Mean log-power and prominence [B, 2, n] over the patches at frequencies [B, K, 2, n, 2].

    Also 1 where enough of them hold it, else 0, as then the means are.
    """
    loud, prominence, inside = spectra.read(places)
    counted = tf.cast(inside, tf.float32) * spectra.valid[:, None, None]
    number = tf.reduce_sum(counted, axis=1)
    enough = tf.cast(number > 2, tf.float32)
    share = counted / tf.maximum(number, 1)[:, None]
    return tf.reduce_sum(loud * share, 1) * enough, tf.reduce_sum(prominence * share, 1) * enough, enough


class Family(NamedTuple):
    """What was chosen: the lattice [6], how much finer it is than the lines that were followed [2], the
    share of all likelihood that is its own, and 1 where anything was plausible at all."""

    lattice: tf.Tensor
    factors: tf.Tensor
    share: tf.Tensor
    plausible: tf.Tensor


def select_family(
    spectra: Spectra, lattices: tf.Tensor, good: tf.Tensor, view: tf.Tensor, weights: tf.Tensor
) -> Family:
    """The likeliest of lattices [B, 6], those that are `good` [B], each taken for any of its teeth.

    The two directions are judged apart, as each may have followed another tooth, but must agree in the end.
    `view` [3] is the picture's longer side in periods of the finest lines: roughly (0 if unknown), at
    least, at most.
    """
    count, teeth = lattices.shape[0], len(FAMILY_FACTORS)
    every = tf.reshape(rescale(lattices[:, None], tf.constant([[t, t] for t in FAMILY_FACTORS])), [-1, 6])
    score = tf.reshape(score_families(spectra, every, weights), [count, teeth, 2])
    pairs = tf.constant([[[across, down] for down in FAMILY_FACTORS] for across in FAMILY_FACTORS])
    family = rescale(lattices[:, None, None], pairs)
    periods = 2 * rate(family)
    total = (score[:, :, None, 0] + score[:, None, :, 1]) / 2 + _scale_log_likelihood(periods, view[0])
    plausible = _is_plausible(family) & (periods >= view[1]) & (periods <= view[2]) & good[:, None, None]
    flat = tf.reshape(tf.where(plausible, total, -1e6), [-1])
    best = tf.argmax(flat, output_type=tf.int32)
    likelihood = tf.exp(flat - tf.reduce_max(flat))
    alike = tf.abs(tf.reshape(periods, [-1]) / tf.gather(tf.reshape(periods, [-1]), best) - 1) < _ALIKE
    share = tf.reduce_sum(tf.where(alike, likelihood, 0.0)) / tf.reduce_sum(likelihood)
    return Family(
        tf.gather(tf.reshape(family, [-1, 6]), best),
        tf.gather(tf.reshape(pairs, [-1, 2]), best % teeth**2),
        share,
        tf.cast(tf.reduce_any(plausible), tf.float32),
    )


def _scale_log_likelihood(periods: tf.Tensor, rough: tf.Tensor) -> tf.Tensor:
    """Log-likelihood of a number of periods, given a rough one or 0."""
    away = tf.math.log(periods / tf.maximum(rough, 1e-3)) / _ROUGH
    return tf.where(rough > 0, tf.math.log(tf.exp(-0.5 * away * away) + _WRONG), 0.0)


def _is_plausible(lattice: tf.Tensor) -> tf.Tensor:
    """Whether lattices [..., 6] are square and not steeper than a phone is held."""
    across = rates(lattice)
    square = tf.reduce_max(across, axis=-1) <= _SQUARE * tf.reduce_min(across, axis=-1)
    return square & (tf.norm(lattice[..., 4:], axis=-1) <= _STEEPEST)
