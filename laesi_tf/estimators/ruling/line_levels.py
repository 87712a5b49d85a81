"""Ask the whole sheet which lines are printed: finer ones than the fitted, and every which one is heavier.

Once the sheet is fitted, every window knows the phase of any wave of the print, whatever its order. Adding
the windows' amplitudes in phase raises a wave that is printed above the noise by the number of windows and
averages out what is not, so that millimetre lines are found that no single window shows.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling.params import LevelParams
from laesi_tf.estimators.ruling.spectra import Windows, measure_waves
from laesi_tf.estimators.ruling.stage import compile_stage

FINER = (2, 5, 10)
HALF = 0.5
"""Factor of lines that were fitted to their first harmonic."""
_ORDERS = np.arange(1, 13, dtype=np.float32)
_TENTHS = np.array([3, 7, 9, 11], np.float32) / 10
_FIFTHS = np.array([2, 4, 6, 8, 12], np.float32) / 10
_HALVES = np.array([5, 15], np.float32) / 10
_QUARTERS = np.array([1, 3, 5], np.float32) / 4
_SIXTHS = np.array([1, 2, 4, 5, 7], np.float32) / 6
_FITTED = np.array([10], np.float32) / 10
_HIGHEST = len(_TENTHS) + len(_FIFTHS) - 1
"""Place of the wave at 12 tenths among all of them."""


class CoherentSum(NamedTuple):
    """Mean complex amplitudes over all windows, [2 families, K] each."""

    real: tf.Tensor
    imaginary: tf.Tensor
    error: tf.Tensor
    """Standard error of the mean, from the windows' scatter."""
    reachable: tf.Tensor
    """bool, the frequency lies below the highest that is asked, in most windows."""

    @property
    def amplitude(self) -> tf.Tensor:
        """[2, K]."""
        return tf.sqrt(self.real**2 + self.imaginary**2 + 1e-12)


class FinerLines(NamedTuple):
    """What is printed between the fitted lines."""

    factor: tf.Tensor
    """1, 2, 5 or 10: how many times finer lines are printed; 1/5 or 1/10 where only coarser ones are. Float
    scalar."""
    excluded: tf.Tensor
    """bool [3], of orders 2, 5 and 10: finer lines of that order would have been seen."""


NO_FINER_LINES = FinerLines(1.0, np.zeros(3, bool))
"""What is known of lines whose heavier ones say that they are the finest."""


class HeavierLines(NamedTuple):
    """bool scalars: every n-th line is heavier."""

    second: tf.Tensor
    fourth: tf.Tensor
    fifth: tf.Tensor
    tenth: tf.Tensor
    strength: tf.Tensor
    """[5, 2 families], mean power over its standard error of waves at tenths, fifths, halves, quarters and
    sixths."""
    factors: tf.Tensor
    """[2], by which the families' own finest lines are finer than the fitted: 1, 5/4 or 5/6, or HALF."""
    are_finest: tf.Tensor
    """bool scalar, the fitted lines are printed: they are no harmonic of heavier ones, and do not lie half as
    far apart as printed ones."""

    @property
    def surest(self) -> tf.Tensor:
        """Strength of the waves at fifths or tenths in the family that shows less of them, scalar."""
        return tf.reduce_min(tf.reduce_max(self.strength[:2], 0))


def sum_in_phase(
    windows: Windows, predicted: tf.Tensor, ratios: np.ndarray, params: LevelParams
) -> CoherentSum:
    """Add the windows' waves at `ratios` [K] of the fitted waves, `predicted` [N, 2, 3], turned to a common
    phase."""
    count = len(ratios)
    frequency = predicted[:, :, None, :2] * ratios[:, None]
    waves = measure_waves(windows.ink, tf.reshape(frequency, [-1, 2 * count, 2]))
    turn = -2 * np.pi * tf.reshape(predicted[:, :, None, 2] * ratios, [-1, 2 * count])
    real = waves.real * tf.cos(turn) - waves.imaginary * tf.sin(turn)
    imaginary = waves.real * tf.sin(turn) + waves.imaginary * tf.cos(turn)
    length = tf.norm(tf.reshape(frequency, [-1, 2 * count, 2]), axis=-1)
    inside = tf.cast(length < params.highest, tf.float32)
    loudness = tf.sqrt(tf.reduce_mean(windows.ink**2, [1, 2]) + 1e-9)
    weight = (windows.weights / loudness)[:, None] * inside
    total = tf.reduce_sum(weight, 0) + 1e-9
    mean_re, mean_im = (tf.reduce_sum(weight * part, 0) / total for part in (real, imaginary))
    scatter = tf.reduce_sum(weight**2 * ((real - mean_re) ** 2 + (imaginary - mean_im) ** 2), 0)
    number = tf.reduce_sum(tf.sign(windows.weights))
    seen = tf.reduce_sum(inside * tf.sign(windows.weights)[:, None], 0)
    real, imaginary, error, seen = (
        tf.reshape(part, [2, count]) for part in (mean_re, mean_im, tf.sqrt(scatter) / total, seen)
    )
    return CoherentSum(real, imaginary, error, seen > 0.6 * number)


@compile_stage
def find_finer(windows: Windows, predicted: tf.Tensor, *, params: LevelParams) -> FinerLines:
    """Return whether the 2nd, 5th or 10th wave stands out of the fitted lines' own harmonics.

    Sharp heavy lines have waves of all orders, whose strength falls smoothly with the order; lines in between
    add to every second, fifth or tenth only.
    """
    sums = sum_in_phase(windows, predicted, _ORDERS, params)
    amplitude = tf.maximum(sums.amplitude, sums.error)
    log = tf.math.log(amplitude)

    def at(order: int) -> tf.Tensor:
        return log[:, order - 1]

    squares = 0.625 * at(1) + 0.375 * at(3)
    fifth = tf.maximum((4 * (at(4) + at(6)) - at(3) - at(7)) / 6, _mean_by_square(at(4), at(6), 4, 5, 6))
    tenth = tf.maximum((4 * (at(9) + at(11)) - at(8) - at(12)) / 6, _mean_by_square(at(8), at(12), 8, 10, 12))
    expected = tf.stack([squares, fifth, tenth], 1)
    places = np.array(FINER) - 1
    here = tf.gather(log, places, axis=1)
    beside = tf.stack([at(3), tf.maximum(at(4), at(6)), tf.maximum(at(9), at(11))], 1)
    clear = tf.gather(amplitude / sums.error, places, axis=1) > params.clear
    # A wave is judged by its neighbours only where the next higher one can be measured as well.
    reachable = tf.gather(sums.reachable, places + 1, axis=1)
    excess = tf.reduce_mean(here - expected, 0)
    stands = tf.reduce_all(clear & reachable & (here - beside > -0.25) & (here - expected > 0.1), 0)
    found = stands & (excess > params.excess)
    # Lines at fifths make a tenth wave as well; lines at tenths of which every fifth is heavier make no
    # fifth wave.
    found = found & ~tf.stack([False, False, found[1] & ~found[0]])
    factors = tf.where(found, tf.constant(FINER, tf.float32), 1.0)
    error = tf.gather(sums.error, places, axis=1) / tf.exp(expected)
    excluded = tf.reduce_all(reachable & (error < params.excluded), 0) & (excess < params.excess)
    return FinerLines(tf.reduce_max(factors), excluded)


@compile_stage
def find_coarser(windows: Windows, predicted: tf.Tensor, *, params: LevelParams) -> tf.Tensor:
    """Return how many times farther apart the lines are than the fitted waves: 10, 5 or 1, float scalar.

    The cells can take a harmonic of wide squares for lines. Where nothing is printed between the lines, the
    wave that was fitted is one of a row of harmonics whose strength falls smoothly; lines in between, or
    doubled ones, would break the row.
    """
    rows = [np.array([7, 8, 9, 10, 11], np.float32) / 10, np.array([4, 6, 8, 10, 12], np.float32) / 10]
    sums = sum_in_phase(windows, predicted, np.concatenate(rows), params)
    logs = tf.math.log(tf.maximum(sums.amplitude, sums.error))
    clear = sums.reachable & (sums.amplitude > params.clear * sums.error)
    found = []
    half = len(rows[0])
    for first in (0, half):
        # Slices, as LiteRT does not split truth values.
        row, seen = (part[:, first : first + half] for part in (logs, clear))
        bends = row[:, :-2] + row[:, 2:] - 2 * row[:, 1:-1]
        found.append(tf.reduce_all(seen) & (tf.reduce_max(tf.abs(bends)) < params.smooth))
    return tf.where(found[0], 10.0, tf.where(found[1], 5.0, 1.0))


def _mean_by_square(low: tf.Tensor, high: tf.Tensor, below: int, order: int, above: int) -> tf.Tensor:
    """Return logarithms interpolated from orders `below` and `above` to `order`, as of a Gaussian blur."""
    share = (order**2 - below**2) / (above**2 - below**2)
    return (1 - share) * low + share * high


@compile_stage
def find_heavier(windows: Windows, predicted: tf.Tensor, *, params: LevelParams) -> HeavierLines:
    """Return which of the fitted lines are heavier, and whether they are the finest at all.

    Heavier lines make waves between the fitted ones. Doubled heavy fives can be stronger at 4/5 or 6/5 of the
    finest wave than the finest itself, and the fit of one family may then hold on to those: that family alone
    shows waves at quarters or sixths, and has none at fifths. Where blur or harsh light takes the finest
    lines' own wave, both fits may hold on to its first harmonic: then every fifth line of the print is a
    tenth, and every tenth a twentieth, which makes waves at quarters; no paper has heavier tenths and
    fourths.
    """
    groups = [_TENTHS, _FIFTHS, _HALVES, _QUARTERS, _SIXTHS, _FITTED]
    sums = sum_in_phase(windows, predicted, np.concatenate(groups), params)
    signal = (sums.real**2 + sums.imaginary**2) / (sums.error**2 + 1e-9) * tf.cast(sums.reachable, tf.float32)
    parts = tf.split(signal, [len(group) for group in groups], axis=1)
    strength = tf.stack([tf.reduce_mean(part, 1) for part in parts[:-1]])
    there = (tf.reduce_mean(strength, 1) > params.heavy) & (tf.reduce_min(strength, 1) > params.heavy / 2)
    _, fifths, _, quarters, sixths = tf.unstack(strength)
    wins = fifths[::-1] > params.heavy / 2
    # Tens that are doubled as well make waves at quarters of 6/5 and at sixths of 4/5.
    is_quarter = (quarters > params.harmonic) & (fifths < 0.25 * quarters) & wins & (quarters > sixths)
    is_sixth = (sixths > params.harmonic) & (fifths < 0.25 * sixths) & wins & ~is_quarter
    factors = tf.where(is_quarter, 1.25, tf.where(is_sixth, 5 / 6, 1.0))
    tenth = there[0]
    factors = tf.where(tenth & there[3], HALF, factors)
    row = _Harmonics(tf.math.log(tf.maximum(sums.amplitude, sums.error)))
    is_printed = (row.measure_excess() > params.own_excess) | ~tf.reduce_all(sums.reachable[:, _HIGHEST])
    return HeavierLines(
        second=there[2] & ~tenth & ~there[1] & ~there[3],
        fourth=there[3] & ~there[1] & ~tenth,
        fifth=there[1] & (~tenth | (_fifths_over_tenths(sums.amplitude) > params.fifth_excess)),
        tenth=tenth,
        strength=strength,
        factors=factors,
        are_finest=is_printed & ~(tenth & row.may_be_doubled(params)),
    )


class _Harmonics:
    """Waves of heavier lines, a row that is smooth where nothing else is printed."""

    def __init__(self, logs: tf.Tensor) -> None:
        """Take logarithms of amplitudes [2 families, K], first those at `_TENTHS`, `_FIFTHS` and `_HALVES`,
        last that of the fitted lines."""
        order = [*_TENTHS, *_FIFTHS, *_HALVES]
        self._at = {round(10 * float(ratio)): logs[:, place] for place, ratio in enumerate(order)}
        self._at[10] = logs[:, -1]

    def measure_excess(self) -> tf.Tensor:
        """Return how far the fitted lines' wave lies above the row at fifths, ln of amplitude, scalar.

        A parabola, as of a Gaussian blur, leads through the neighbours at 6, 8 and 12 tenths.
        """
        at = self._at
        slope, next_slope = (at[8] - at[6]) / 2, (at[12] - at[8]) / 4
        expected = at[6] + 4 * slope + 8 * (next_slope - slope) / 6
        return tf.reduce_mean(at[10] - expected)

    def may_be_doubled(self, params: LevelParams) -> tf.Tensor:
        """Return whether tenths may be fives, and the fitted lines half as far apart as printed ones, bool
        scalar.

        Then the wave at the half stands out of its row, and farther than the fitted one. On paper with
        heavier second lines it seldom does: the finest lines add to the one wave and take from the other.
        """
        at = self._at
        beside = {order: (at[order - 1] + at[order + 1]) / 2 for order in (5, 10)}
        half, whole = (tf.exp(at[order]) - tf.exp(beside[order]) for order in (5, 10))
        return tf.reduce_all((at[5] - beside[5] > params.half_excess) & (half > whole))


def _fifths_over_tenths(amplitude: tf.Tensor) -> tf.Tensor:
    """Return how much the waves at fifths exceed those at odd tenths beside them, mean of the logarithms.

    `amplitude` [2 families, K] begins with those at `_TENTHS`, `_FIFTHS` and `_HALVES`. Lines of which every
    tenth alone is heavier make waves at all tenths, whose amplitude falls slowly: as much below a fifth as
    it lies above it.
    """
    logs = tf.math.log(tf.reduce_mean(amplitude, 0) + 1e-9)
    third, seventh, ninth, fifth = logs[0], logs[1], logs[2], logs[9]
    beside = tf.stack([third + fifth, fifth + seventh, seventh + ninth]) / 2
    return tf.reduce_mean(logs[5:8] - beside)
