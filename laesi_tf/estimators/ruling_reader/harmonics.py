"""The harmonic score of a ruling, and which of its harmonics belongs to the finest family of lines."""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling_reader.lattice import (
    MAX_PERSPECTIVE,
    lattice_frequencies,
    rate,
    rates,
    rescale,
)
from laesi_tf.estimators.ruling_reader.spectra import BINS, COLUMNS, Spectra, compute_prominences

HARMONICS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 2.0, 5.0)
_GAPS = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95)
_FACTORS = (*HARMONICS, *_GAPS, 1.1, 1.2)
FAMILY_FACTORS = (0.1, 0.2, 0.5, *(10 / harmonic for harmonic in range(1, 11)))
"""How much finer than the fitted lines the finest may be: the fitted lines are one of their harmonics."""
_MAX_ASPECT = 1.15
"""Ratio of scales along and across a sheet that tilt may cause in the middle of the image."""
_SAME_SCALE = 0.02
"""Families whose scales differ by less, relatively, are one."""
_ROUGH_SCALE_SD, _OUTLIER_LIKELIHOOD = 0.1, 0.008
"""Standard deviation of the logarithm of a rough scale; and the likelihood of any other scale, relative to
that of a perfect match: a rough scale is sometimes wrong by far, and the harmonics may overrule it."""
MILLIMETRES = np.array([0.5, 1.7, 0.53, -1.39, -0.51, -2.21, 0.21, 0.74, -1.54], np.float32)
"""Weights, log-odds, of `_compute_features` on paper whose every fifth or tenth line is heavier.

Multinomial logistic regression, as of a choice among all candidates, on 260 scenes of `rendering_2` (seed 11,
768 x 768 and 1536 x 1152) without a rough scale. The softmax is then the probability that a family is right.
Validated on 300 other scenes (seed 12, three sizes): of 292 readings without a rough scale 23 had a
probability below 0.9, on average 0.82, and of 296 with one 9, on average 0.73; one of all these was off by
more than 1 %, with a probability of 0.6.
"""
PLAIN = np.array([1.0, -0.5, 0.5, -1.0, -2.0, -2.0, 1.0, 1.0, -1.5], np.float32)
"""The same for squared paper, where heavier lines are rare, set by hand."""
_ANGLES = np.deg2rad(np.arange(0, 180, 1.0))
_STEP = 0.02
_FREQUENCIES = np.exp(np.arange(math.log(1 / 80), math.log(0.46), _STEP))


def find_seeds(spectra: Spectra, stride: int) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Return the best untilted lattice of every `stride`-th patch.

    Returns lattices [n, 6], centres of the patches [n, 2] and scores [n].
    """
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
    """Return the weighted prominences of fine lines and of heavier ones, every fifth or every tenth.

    Lines at odd tenths are evidence against every fifth being heavier, and for every tenth.
    """
    even, odd = _mean_even_and_odd(values)
    return values[1.0] + 1.5 * tf.maximum(even - 0.5 * odd, (4 * even + 5 * odd) / 9) + 0.25 * values[2.0]


def _polar_bins() -> np.ndarray:
    """Return the flat index [angles, frequencies] of the bin in each direction at each frequency."""
    place = np.stack(
        [np.outer(np.cos(_ANGLES), _FREQUENCIES), np.outer(np.sin(_ANGLES), _FREQUENCIES)], axis=-1
    )
    place *= np.where(place[..., :1] < 0, -BINS, BINS)
    column, row = np.moveaxis(np.round(place).astype(np.int32), -1, 0)
    return row % BINS * COLUMNS + column


def _stretch(polar: tf.Tensor, factor: float) -> tf.Tensor:
    """Return `polar` [..., frequencies] at `factor` times each frequency, zero outside the range."""
    shift = round(math.log(factor) / _STEP)
    if shift >= 0:
        return tf.pad(polar[..., shift:], [[0, 0], [0, 0], [0, shift]])
    return tf.pad(polar[..., :shift], [[0, 0], [0, 0], [-shift, 0]])


def score_families(spectra: Spectra, lattice: tf.Tensor, weights: tf.Tensor) -> tf.Tensor:
    """Return the log-odds [B, 2] that the lines of lattices [B, 6] are the finest, in both directions.

    `weights` [9] are those of the features.
    """
    frequencies = (
        lattice_frequencies(lattice, spectra.centres)[..., None, :] * np.array(_FACTORS, np.float32)[:, None]
    )
    means = _mean_over_patches(spectra, frequencies)
    power, prominent, present = (
        dict(zip(_FACTORS, tf.unstack(part, axis=-1), strict=True)) for part in means
    )
    return tf.reduce_sum(tf.stack(_compute_features(power, prominent, present), axis=-1) * weights, axis=-1)


def _compute_features(
    power: dict[float, tf.Tensor], prominent: dict[float, tf.Tensor], present: dict[float, tf.Tensor]
) -> list[tf.Tensor]:
    """Return the features for and against a family being the finest, each [B, 2].

    The finest lines are prominent, with the harmonics of heavier ones below them and their second harmonic
    above. They have more power than their second or fifth harmonic, and at one half there is no peak above
    its neighbours. They have more power than the neighbouring harmonics, which are those of heavier lines
    alone; and between the harmonics there are no peaks.
    """
    even, odd = _mean_even_and_odd(prominent)
    heavier = tf.maximum(even - 0.5 * odd, (4 * even + 5 * odd) / 9)
    halves = present[0.4] * present[0.5] * present[0.6]
    return [
        prominent[1.0],
        heavier,
        prominent[2.0],
        tf.nn.relu(power[2.0] - power[1.0]) * present[2.0],
        tf.nn.relu(power[5.0] - power[1.0]) * present[5.0],
        tf.nn.relu(power[0.5] - tf.maximum(power[0.4], power[0.6])) * halves,
        _compute_rise(power, present, 0.8, 1.2),
        _compute_rise(power, present, 0.9, 1.1),
        tf.add_n([prominent[gap] for gap in _GAPS]) / len(_GAPS),
    ]


def _mean_even_and_odd(values: dict[float, tf.Tensor]) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the mean prominence of the harmonics of every fifth line, and of the others of every tenth."""
    even = (values[0.2] + values[0.4] + values[0.6] + values[0.8]) / 4
    odd = (values[0.1] + values[0.3] + values[0.5] + values[0.7] + values[0.9]) / 5
    return even, odd


def _compute_rise(
    power: dict[float, tf.Tensor], present: dict[float, tf.Tensor], before: float, after: float
) -> tf.Tensor:
    """Return the log-power of the finest lines over the harmonics `before` and `after` them, in -3..3."""
    beyond = tf.where(present[after] > 0, power[after], power[before])
    return tf.clip_by_value(power[1.0] - tf.maximum(power[before], beyond), -3, 3) * present[before]


def _mean_over_patches(spectra: Spectra, frequencies: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Return the mean log-power and prominence [B, 2, n] over the patches at frequencies [B, K, 2, n, 2].

    The third result is 1 where more than two patches contain the frequency, else 0, as are then the means.
    """
    power, prominence, inside = spectra.read(frequencies)
    counted = tf.cast(inside, tf.float32) * spectra.valid[:, None, None]
    number = tf.reduce_sum(counted, axis=1)
    enough = tf.cast(number > 2, tf.float32)
    share = counted / tf.maximum(number, 1)[:, None]
    return tf.reduce_sum(power * share, 1) * enough, tf.reduce_sum(prominence * share, 1) * enough, enough


class Family(NamedTuple):
    """The selected family of lines."""

    lattice: tf.Tensor
    """[6]."""
    factors: tf.Tensor
    """[2], how much finer it is than the fitted lines."""
    share: tf.Tensor
    """Its share of the likelihood of all families."""
    plausible: tf.Tensor
    """1 where any family was plausible, else 0."""


def select_family(
    spectra: Spectra, lattices: tf.Tensor, good: tf.Tensor, view: tf.Tensor, weights: tf.Tensor
) -> Family:
    """Select the most likely family of the `good` [B] lattices [B, 6], each taken for any of its harmonics.

    The two directions are scored separately, as each fit may have followed another harmonic, but must agree.
    `view` [3] is the longer side of the photo in periods of the finest lines: roughly (0 if unknown), at
    least, at most.
    """
    count, factors = lattices.shape[0], len(FAMILY_FACTORS)
    every = tf.reshape(rescale(lattices[:, None], tf.constant([[t, t] for t in FAMILY_FACTORS])), [-1, 6])
    score = tf.reshape(score_families(spectra, every, weights), [count, factors, 2])
    pairs = tf.constant([[[across, down] for down in FAMILY_FACTORS] for across in FAMILY_FACTORS])
    family = rescale(lattices[:, None, None], pairs)
    periods = 2 * rate(family)
    total = (score[:, :, None, 0] + score[:, None, :, 1]) / 2 + _scale_log_likelihood(periods, view[0])
    plausible = _is_plausible(family) & (periods >= view[1]) & (periods <= view[2]) & good[:, None, None]
    flat = tf.reshape(tf.where(plausible, total, -1e6), [-1])
    best = tf.argmax(flat, output_type=tf.int32)
    likelihood = tf.exp(flat - tf.reduce_max(flat))
    alike = tf.abs(tf.reshape(periods, [-1]) / tf.gather(tf.reshape(periods, [-1]), best) - 1) < _SAME_SCALE
    share = tf.reduce_sum(tf.where(alike, likelihood, 0.0)) / tf.reduce_sum(likelihood)
    return Family(
        tf.gather(tf.reshape(family, [-1, 6]), best),
        tf.gather(tf.reshape(pairs, [-1, 2]), best % factors**2),
        share,
        tf.cast(tf.reduce_any(plausible), tf.float32),
    )


def _scale_log_likelihood(periods: tf.Tensor, rough: tf.Tensor) -> tf.Tensor:
    """Return the log-likelihood of a number of periods, given a rough one or 0."""
    away = tf.math.log(periods / tf.maximum(rough, 1e-3)) / _ROUGH_SCALE_SD
    return tf.where(rough > 0, tf.math.log(tf.exp(-0.5 * away * away) + _OUTLIER_LIKELIHOOD), 0.0)


def _is_plausible(lattice: tf.Tensor) -> tf.Tensor:
    """Return whether lattices [..., 6] are square and no more tilted than a phone is held."""
    across = rates(lattice)
    square = tf.reduce_max(across, axis=-1) <= _MAX_ASPECT * tf.reduce_min(across, axis=-1)
    return square & (tf.norm(lattice[..., 4:], axis=-1) <= MAX_PERSPECTIVE)
