"""The waves of the printed lines in windows: what a sheet predicts, and what is measured."""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.common.sheet_model import SheetModel, to_lines
from laesi_tf.estimators.ruling.params import WaveParams
from laesi_tf.estimators.ruling.spectra import SIDE, SPREAD_PX, Windows, measure_waves
from laesi_tf.estimators.ruling.stage import compile_stage

_REACH_PX = 1.55 * SPREAD_PX
"""Distance of the points that stand for a window: the square root of the Hann window's fourth moment over its
second."""
_PHASE_SHARE = 2 * SPREAD_PX**2 / _REACH_PX**2
"""The mean of a quadratic phase over the window, by the mean over its four outer points."""


class Measured(NamedTuple):
    """What the windows say: [N, 2 families, 3] of frequency x, frequency y (per pixel) and phase
    (periods)."""

    values: tf.Tensor
    errors: tf.Tensor
    """Standard deviations, the same shape."""
    weights: tf.Tensor
    """[N, 2], 0 where the family does not stand out."""


def window_points(windows: Windows, size: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the normalised points [N, 5, 2] that stand for the windows, and their pixels' normalised size.

    `size` [2] is the photo's (height, width) in frame pixels.
    """
    unit = tf.reduce_max(size) / 2
    middles = (windows.middles - tf.reverse(size, [0]) / 2) / unit
    pixel = windows.step / unit
    around = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], np.float32) * _REACH_PX
    return middles[:, None] + around * pixel, pixel


def predict_waves(parameters: tf.Tensor, points: tf.Tensor) -> tf.Tensor:
    """Return the frequencies and phases [..., N, 2, 3] that `parameters` [..., COUNT] predict.

    The windows are at `points` [N, 5, 2].
    """
    model = SheetModel(*(part[..., None] for part in tf.unstack(parameters[..., None, :], axis=-1)))
    lines = tf.stack(to_lines(model, points[..., 0], points[..., 1]), -2)
    middle, right, left, below, above = tf.unstack(lines, axis=-1)
    mean = (right + left + below + above) / 4
    double = 2 * _REACH_PX
    return tf.stack(
        [(right - left) / double, (below - above) / double, middle + _PHASE_SHARE * (mean - middle)], -1
    )


@compile_stage
def measure(
    windows: Windows, noise: tf.Tensor, frequency: tf.Tensor, *, params: WaveParams
) -> tuple[Measured, tf.Tensor]:
    """Measure both families at `frequency` [N, 2, 2], which is near to theirs.

    Return the waves, and their signal to noise [N, 2].
    """
    waves = measure_waves(windows.ink, frequency)
    length = tf.norm(frequency, axis=-1)
    signal = waves.power / noise
    near = tf.norm(waves.correction, axis=-1) < tf.minimum(1.2 / SIDE, 0.09 * length)
    weight = windows.weights[:, None] * tf.cast((signal > params.faintest) & near, tf.float32)
    turn = 1 / (2 * np.pi * tf.sqrt(2 * signal + 1e-6))
    error_f = tf.sqrt((turn / SPREAD_PX) ** 2 + (params.frequency_floor * length) ** 2)
    error_p = tf.sqrt(turn**2 + params.phase_floor**2)
    phase = tf.atan2(waves.imaginary, waves.real) / (2 * np.pi)
    values = tf.concat([frequency + waves.correction, phase[..., None]], -1)
    return Measured(values, tf.stack([error_f, error_f, error_p], -1), weight), signal


def masked_median(values: tf.Tensor, mask: tf.Tensor) -> tf.Tensor:
    """Return the median of `values` [n] where `mask` [n] is true; large where it never is."""
    order = tf.sort(tf.where(mask, values, 1e9))
    count = tf.reduce_sum(tf.cast(mask, tf.int32))
    return tf.gather(order, tf.maximum(count - 1, 0) // 2)


def wrap(phase: tf.Tensor) -> tf.Tensor:
    """Return `phase`, in periods, moved to -0.5..0.5."""
    return phase - tf.round(phase)


def residuals(parameters: tf.Tensor, points: tf.Tensor, measured: Measured) -> tf.Tensor:
    """Return (measured - predicted) / standard deviation, [..., N, 2, 3]."""
    return (measured.values - predict_waves(parameters, points)) / measured.errors


def unwrap(
    residual: tf.Tensor, slope: tf.Tensor, error: tf.Tensor, middles: tf.Tensor, weight: tf.Tensor
) -> tf.Tensor:
    """Return phase residuals [N, 2] made continuous from window to nearest window.

    `slope` [N, 2, 2] are the frequency residuals with standard deviations `error` [N, 2]; `middles` [N, 2]
    are in the same pixels.
    """
    count = residual.shape[0]
    size = slope**2
    slope = slope * size / (size + (2 * error[..., None]) ** 2)
    rank = tf.reduce_min(weight, 1)
    first = tf.one_hot(tf.argmax(rank), count)
    distance = tf.norm(middles[:, None] - middles[None], axis=-1)

    def visit(
        turn: tf.Tensor, visited: tf.Tensor, value: tf.Tensor
    ) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
        far = tf.where((visited[:, None] > 0) & (visited[None] < 1), distance - 1e3 * tf.sign(rank), 1e9)
        best = tf.argmin(tf.reshape(far, [-1]), output_type=tf.int32)
        from_, to = best // count, best % count
        way = tf.gather(middles, to) - tf.gather(middles, from_)
        mean = (tf.gather(slope, from_) + tf.gather(slope, to)) / 2
        expected = tf.gather(value, from_) + tf.linalg.matvec(mean, way)
        here = expected + wrap(tf.gather(residual, to) - expected)
        new = tf.one_hot(to, count)
        return turn + 1, visited + new, value + new[:, None] * here

    start = wrap(residual) * first[:, None]
    _, _, value = tf.while_loop(
        lambda turn, *_: turn < count - 1, visit, (tf.constant(0), first, start), maximum_iterations=count - 1
    )
    return value
