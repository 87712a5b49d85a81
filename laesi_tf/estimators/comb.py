"""The comb that the harmonics of a ruling make, and which of its teeth is the finest family of lines."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.lattice import gradients, rate, rates, rescaled
from laesi_tf.estimators.spectra import BINS, COLUMNS, MARGIN, ROWS, SIDE, Spectra

HARMONICS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 2.0, 5.0)
TEETH = (0.1, 0.2, 0.5, *(10 / tooth for tooth in range(1, 11)))
"""How much finer than the lines that were followed the finest may be: these were any tooth of the comb."""
_SQUARE = 1.15
"""Ratio of scales along and across a sheet that tilt may cause in the middle of the picture."""
_STEEPEST = 0.4
"""Change of scale from the middle to the border that a fit may claim: twice that of a tilt of 20 degrees."""
_TRUST = 15.0
"""Score that a lattice loses per squared logarithm of its distance from a rough scale.

At a factor of 1.6 that is what a weak comb is behind a strong one: the comb overrules a rough scale that is
wrong, and yields to a good one where its family is in doubt.
"""
_ANGLES = np.deg2rad(np.arange(0, 180, 1.0))
_STEP = 0.02
_FREQUENCIES = np.exp(np.arange(math.log(1 / 80), math.log(0.46), _STEP))


def combined(values: dict[float, tf.Tensor]) -> tf.Tensor:
    """Weigh the comb's prominences: fine lines, and behind every fifth or every tenth a heavier one.

    Lines at odd tenths speak against every fifth being heavier, and for every tenth.
    """
    even = (values[0.2] + values[0.4] + values[0.6] + values[0.8]) / 4
    odd = (values[0.1] + values[0.3] + values[0.5] + values[0.7] + values[0.9]) / 5
    return values[1.0] + 1.5 * tf.maximum(even - 0.5 * odd, (4 * even + 5 * odd) / 9) + 0.25 * values[2.0]


def seeds(spectra: Spectra, stride: int) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """The best untilted lattice of every `stride`-th patch: lattices [n, 6], patches' centres [n, 2], scores [n]."""
    chosen = spectra.prominence[::stride] * spectra.valid[::stride, None, None]
    table = _polar_bins()
    polar = tf.gather(tf.reshape(chosen, [chosen.shape[0], -1]), table.ravel(), axis=1)
    polar = tf.reshape(polar, [-1, *table.shape])
    both = polar[:, : table.shape[0] // 2] + polar[:, table.shape[0] // 2 :]
    score = combined({factor: _stretched(both, factor) for factor in HARMONICS})
    flat = tf.reshape(score, [score.shape[0], -1])
    best = tf.argmax(flat, axis=1, output_type=tf.int32)
    angle = tf.gather(_ANGLES.astype(np.float32), best // len(_FREQUENCIES))
    along = tf.gather(_FREQUENCIES.astype(np.float32), best % len(_FREQUENCIES)) * BINS / spectra.bins[::stride]
    a, b = along * tf.cos(angle), along * tf.sin(angle)
    none = tf.zeros_like(a)
    return tf.stack([a, b, -b, a, none, none], axis=1), spectra.centres[::stride], tf.reduce_max(flat, axis=1)


def _polar_bins() -> np.ndarray:
    """Flat index [angles, frequencies] of the bin that lies in each direction at each frequency."""
    place = np.stack(
        [np.outer(np.cos(_ANGLES), _FREQUENCIES), np.outer(np.sin(_ANGLES), _FREQUENCIES)], axis=-1
    )
    place *= np.where(place[..., :1] < 0, -BINS, BINS)
    column, row = np.moveaxis(np.round(place).astype(np.int32), -1, 0)
    return (row + ROWS // 2) * COLUMNS + column + MARGIN


def _stretched(polar: tf.Tensor, factor: float) -> tf.Tensor:
    """`polar` [..., frequencies] read at `factor` times each frequency, zero outside the range."""
    shift = round(math.log(factor) / _STEP)
    if shift >= 0:
        return tf.pad(polar[..., shift:], [[0, 0], [0, 0], [0, shift]])
    return tf.pad(polar[..., :shift], [[0, 0], [0, 0], [-shift, 0]])


def scores(spectra: Spectra, lattice: tf.Tensor) -> tf.Tensor:
    """The comb's score [B, 2] in both directions, less what says that other lines are the finest.

    The finest lines are louder than their own second or fifth harmonic, and no tooth at one half rises over
    its neighbours: there only every tenth line could be heard.
    """
    places = gradients(lattice, spectra.centres)[..., None, :] * np.float32(HARMONICS)[:, None]
    prominence, there = _mean(spectra, spectra.prominence, places)
    loudness, _ = _mean(spectra, spectra.loud, places)
    prominent = dict(zip(HARMONICS, tf.unstack(prominence, axis=-1), strict=True))
    loud = dict(zip(HARMONICS, tf.unstack(loudness, axis=-1), strict=True))
    heard = dict(zip(HARMONICS, tf.unstack(there, axis=-1), strict=True))
    neighbours = tf.maximum(loud[0.4], loud[0.6])
    against = (
        tf.nn.relu(loud[2.0] - loud[1.0]) * heard[2.0]
        + tf.nn.relu(loud[5.0] - loud[1.0]) * heard[5.0]
        + tf.nn.relu(loud[0.5] - neighbours) * heard[0.4] * heard[0.6] * heard[0.5]
    )
    return combined(prominent) - 2 * against


def _mean(spectra: Spectra, values: tf.Tensor, places: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Mean of `values` over the patches at frequencies [B, K, 2, n, 2]: [B, 2, n], and 1 where enough hold it."""
    seen, inside = spectra.read(values, places)
    counted = tf.cast(inside, tf.float32) * spectra.valid[:, None, None]
    number = tf.reduce_sum(counted, axis=1)
    enough = tf.cast(number > 2, tf.float32)
    return tf.reduce_sum(seen * counted, axis=1) / tf.maximum(number, 1) * enough, enough


def best_family(
    spectra: Spectra, lattices: tf.Tensor, good: tf.Tensor, view: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """The lattice [6] whose lines make the best comb, each of [B, 6] taken for any of its teeth.

    Also how much finer it is [2] than the lines that were followed, and its score [].

    The two directions are judged apart, as each may have followed another tooth, but must agree in the end.
    `view` [3] is the picture's longer side in periods of the finest lines: roughly (0 if unknown), at
    least, at most. The score is below -1e3 where nothing is plausible.
    """
    count, teeth = lattices.shape[0], len(TEETH)
    every = tf.reshape(rescaled(lattices[:, None], tf.constant([[t, t] for t in TEETH])), [-1, 6])
    score = tf.reshape(scores(spectra, every), [count, teeth, 2])
    pairs = tf.constant([[[across, down] for down in TEETH] for across in TEETH])
    family = rescaled(lattices[:, None, None], pairs)
    periods = 2 * rate(family)
    doubt = tf.where(view[0] > 0, _TRUST * tf.math.log(periods / tf.maximum(view[0], 1e-3)) ** 2, 0.0)
    total = (score[:, :, None, 0] + score[:, None, :, 1]) / 2 - doubt
    plausible = _plausible(family) & (periods >= view[1]) & (periods <= view[2]) & good[:, None, None]
    flat = tf.reshape(tf.where(plausible, total, -1e6), [-1])
    best = tf.argmax(flat, output_type=tf.int32)
    factors = tf.gather(tf.reshape(pairs, [-1, 2]), best % teeth**2)
    return tf.gather(tf.reshape(family, [-1, 6]), best), factors, tf.gather(flat, best)


def _plausible(lattice: tf.Tensor) -> tf.Tensor:
    """Whether lattices [..., 6] are square and not steeper than a phone is held."""
    across = rates(lattice)
    square = tf.reduce_max(across, axis=-1) <= _SQUARE * tf.reduce_min(across, axis=-1)
    return square & (tf.norm(lattice[..., 4:], axis=-1) <= _STEEPEST)
