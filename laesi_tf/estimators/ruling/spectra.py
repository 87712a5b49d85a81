"""Local spectra of a photo: Hann windows, their Fourier transforms, and waves measured at any frequency.

Frequencies are (x, y) in periods per pixel of the windows' level. The phase of a wave is counted in periods
at the middle of its window.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling.params import SearchParams
from laesi_tf.estimators.ruling.stage import compile_stage
from laesi_tf.models.ruling_cells import LEVELS

SIDE = 128
"""Side of a window, pixels of its level."""
_STEPS = np.arange(SIDE, dtype=np.float32) + 0.5 - SIDE / 2
_HANN = (np.cos(np.pi * _STEPS / SIDE) ** 2).astype(np.float32)
SPREAD_PX = float(np.sqrt((_HANN * _STEPS**2).sum() / _HANN.sum()))
"""Standard deviation of the Hann window as a weight, 23.1 pixels: what a wave is averaged over."""


_SAMPLED = np.sort(np.random.default_rng(0).permutation(SIDE - 3)[: SIDE // 8])
"""Rows and columns that tell the ink's colour; evenly spaced ones would miss lines of the same spacing."""


class Windows(NamedTuple):
    """Windows cut from a photo."""

    ink: tf.Tensor
    """[N, SIDE, SIDE], detail along the ink's colour times the Hann window."""
    middles: tf.Tensor
    """[N, 2], (x, y) in frame pixels."""
    weights: tf.Tensor
    """[N], 0 for windows that are not used."""
    step: tf.Tensor
    """Frame pixels per pixel of the windows, scalar."""


class Waves(NamedTuple):
    """Complex amplitudes of waves in windows, [N, K] each, and the frequencies' errors."""

    real: tf.Tensor
    imaginary: tf.Tensor
    correction: tf.Tensor
    """[N, K, 2], what to add to the frequency at which the wave was measured to come nearer to the wave's
    own."""

    @property
    def power(self) -> tf.Tensor:
        """[N, K]."""
        return self.real**2 + self.imaginary**2


def build_pyramid(frame: tf.Tensor, levels: int) -> list[tf.Tensor]:
    """Return `frame` [F, F, 3] and its means over squares of 2, 4, ... pixels."""
    pyramid = [frame]
    for _ in range(levels - 1):
        pyramid.append(tf.nn.avg_pool2d(pyramid[-1][None], 2, 2, "VALID")[0])
    return pyramid


class Pyramid(NamedTuple):
    """A frame at full resolution, and all its coarser levels as one list of pixels.

    LiteRT copies what a condition uses, and an operation for each level would take a condition.
    """

    full: tf.Tensor
    """[F, F, 3], float32 or uint8."""
    coarser: tf.Tensor
    """[M, 3], float32, the pixels of levels 1, 2, ... row by row."""


def join_levels(levels: list[tf.Tensor]) -> Pyramid:
    """Return the pyramid of `levels`, each [F >> level, F >> level, 3]."""
    return Pyramid(levels[0], tf.concat([tf.reshape(image, [-1, 3]) for image in levels[1:]], 0))


def cut_windows(pyramid: Pyramid, level: tf.Tensor, middles: tf.Tensor, size: tf.Tensor) -> tf.Tensor:
    """Return the pixels [N, SIDE, SIDE, 3] of windows of `level` around `middles` [N, 2], frame pixels.

    What lies beyond the photo of `size` [2] (height, width in frame pixels) repeats its border.
    """
    step = tf.pow(2.0, tf.cast(level, tf.float32))
    last = tf.cast(tf.reverse(size, [0]) / step, tf.int32) - 1
    corner = tf.cast(tf.round(middles / step), tf.int32) - SIDE // 2
    reach = tf.range(SIDE)
    columns, rows = (tf.clip_by_value(corner[:, axis, None] + reach, 0, last[axis]) for axis in (0, 1))
    sides = pyramid.full.shape[0] >> np.arange(LEVELS)
    starts = np.cumsum([0, 0, *sides[1:-1] ** 2])
    places = rows[:, :, None] * tf.gather(tf.constant(sides, tf.int32), level) + columns[:, None, :]
    places += tf.gather(tf.constant(starts, tf.int32), level)
    is_full = tf.equal(level, 0)
    full = tf.gather(tf.reshape(pyramid.full, [-1, 3]), tf.where(is_full, places, 0))
    coarser = tf.gather(pyramid.coarser, tf.where(is_full, 0, places))
    return tf.where(is_full, tf.cast(full, tf.float32), coarser)


def find_ink_colour(pixels: tf.Tensor, weights: tf.Tensor) -> tf.Tensor:
    """Return weights [3], of unit length, of the channels in which pixels a few apart differ most.

    `pixels` are [N, SIDE, SIDE, 3]. Differences are clipped at twice their mean, so that lines count and
    edges of leaves do not.
    """

    def sample(down: int, right: int) -> tf.Tensor:
        return tf.gather(tf.gather(pixels, _SAMPLED + down, axis=1), _SAMPLED + right, axis=2)

    near = sample(0, 0)
    differences = tf.concat([near - sample(down, right) for down, right in ((3, 0), (0, 3), (2, 2))], -1)
    differences = tf.reshape(differences, [pixels.shape[0], -1, 3])
    typical = tf.reduce_mean(tf.abs(differences), [1, 2], keepdims=True) + 0.1
    differences = tf.clip_by_value(differences, -2 * typical, 2 * typical)
    weighted = differences * weights[:, None, None]
    covariance = tf.matmul(tf.reshape(weighted, [-1, 3]), tf.reshape(differences, [-1, 3]), transpose_a=True)
    colour = tf.ones([3, 1])
    for _ in range(6):
        colour = tf.matmul(covariance, colour)
        colour /= tf.norm(colour) + 1e-9
    return colour[:, 0]


def extract_ink(pixels: tf.Tensor, weights: tf.Tensor, ruled: tf.Tensor) -> tf.Tensor:
    """Return the darkness [N, SIDE, SIDE] of the lines in `pixels` [N, SIDE, SIDE, 3].

    Its slow part is removed, and it is multiplied by the Hann window. `ruled` [N, C, C] says on a coarse grid
    where the ruling is, 0..1; the rest is faded out. What stands out more than lines do (edges of leaves) is
    clipped.
    """
    colour = find_ink_colour(pixels, weights)
    grey = tf.linalg.matvec(pixels, -colour)[..., None]
    coarse = tf.nn.avg_pool2d(tf.nn.avg_pool2d(grey, 16, 16, "VALID"), 3, 1, "SAME")
    detail = (grey - tf.image.resize(coarse, [SIDE, SIDE]))[..., 0]
    detail *= tf.image.resize(ruled[..., None], [SIDE, SIDE])[..., 0]
    typical = tf.reduce_mean(tf.abs(detail), [1, 2], keepdims=True) + 0.1
    return tf.clip_by_value(detail, -4 * typical, 4 * typical) * (_HANN[:, None] * _HANN)


def compute_power(ink: tf.Tensor) -> tf.Tensor:
    """Return the power spectra [N, SIDE, SIDE / 2 + 1] of windows."""
    transformed = tf.signal.rfft2d(ink, [SIDE, SIDE])
    return tf.math.real(transformed) ** 2 + tf.math.imag(transformed) ** 2


def read_power(power: tf.Tensor, frequency: tf.Tensor) -> tf.Tensor:
    """Return the power [N, ...] at the nearest bins to `frequency` [N, ..., 2]."""
    count = power.shape[0]
    bins = tf.cast(tf.round(frequency * SIDE), tf.int32)
    column, row = bins[..., 0], bins[..., 1]
    row = tf.where(column < 0, -row, row)
    row = tf.where(row < 0, row + SIDE, row)
    # A frequency that is not finite becomes the lowest integer, which has no absolute value.
    column = tf.clip_by_value(tf.abs(column), 0, SIDE // 2)
    row = tf.clip_by_value(row, 0, SIDE - 1)
    window = tf.reshape(tf.range(count), [count] + [1] * (len(frequency.shape) - 2))
    return tf.gather(tf.reshape(power, [-1]), (window * SIDE + row) * (SIDE // 2 + 1) + column)


@compile_stage
def measure_noise(power: tf.Tensor, length: tf.Tensor) -> tf.Tensor:
    """Return the noise power [N, F] around frequencies of `length` [N, F], periods per pixel.

    It is the geometric mean over all directions. The mean of the logarithm passes over the few bins that hold
    the waves themselves; of pure noise it lies below the mean power by a factor of exp(0.577).
    """
    y = np.fft.fftfreq(SIDE).astype(np.float32)[:, None]
    x = (np.arange(SIDE // 2 + 1) / SIDE).astype(np.float32)
    radius = np.hypot(x, y).reshape(-1)
    low, high = 0.7 * length, 1.4 * length
    near = (radius > low[..., None]) & (radius < high[..., None])
    near = tf.cast(near, tf.float32)
    logs = tf.reshape(tf.math.log(power + 1e-6), [power.shape[0], -1, 1])
    mean = tf.matmul(near, logs)[..., 0] / (tf.reduce_sum(near, -1) + 1e-6)
    return 1.78 * tf.exp(mean)


def measure_waves(ink: tf.Tensor, frequency: tf.Tensor) -> Waves:
    """Return complex amplitudes of waves at `frequency` [N, K, 2] in windows [N, SIDE, SIDE].

    The correction is the first moment's: for a single wave nearby it leads to that wave's frequency.
    """

    def basis(axis: int) -> tuple[tf.Tensor, tf.Tensor]:
        turn = 2 * np.pi * frequency[..., axis, None] * _STEPS
        return tf.cos(turn), -tf.sin(turn)

    (cos_x, sin_x), (cos_y, sin_y) = basis(0), basis(1)
    along_x = tf.concat([cos_x, sin_x, cos_x * _STEPS, sin_x * _STEPS], 1)
    lines = tf.matmul(along_x, ink, transpose_b=True)
    real, imaginary, real_x, imaginary_x = tf.split(lines, 4, 1)

    def sum_y(re: tf.Tensor, im: tf.Tensor, factor: np.ndarray | float) -> tuple[tf.Tensor, tf.Tensor]:
        return (
            tf.reduce_sum((re * cos_y - im * sin_y) * factor, -1),
            tf.reduce_sum((re * sin_y + im * cos_y) * factor, -1),
        )

    z, zx, zy = sum_y(real, imaginary, 1.0), sum_y(real_x, imaginary_x, 1.0), sum_y(real, imaginary, _STEPS)
    size = z[0] ** 2 + z[1] ** 2 + 1e-6
    moments = tf.stack([(m[1] * z[0] - m[0] * z[1]) / size for m in (zx, zy)], -1)
    return Waves(z[0], z[1], moments / (2 * np.pi * SPREAD_PX**2))


@compile_stage
def find_families(
    power: tf.Tensor, weights: tf.Tensor, length: tf.Tensor, direction: tf.Tensor, *, params: SearchParams
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return ln of the factors [2] from the cells' answers to the families' frequencies in all windows.

    `length` [N] (periods per pixel) and `direction` [N] (radians) are the cells' answers. The first result is
    for square pixels, the second for photos that may be stretched.
    """
    ratios = np.linspace(-params.ratio_reach, params.ratio_reach, params.ratio_steps, dtype=np.float32)
    turns = np.linspace(-params.turn_reach, params.turn_reach, params.turn_steps, dtype=np.float32)
    seen = tf.math.log(read_power(power, _polar(length, direction, ratios, turns)) + 1e-6)
    along = tf.reduce_max(seen, -1)
    along -= tf.reduce_mean(along, -1, keepdims=True)
    score = tf.reduce_sum(along * weights[:, None, None], 0)
    total = tf.reduce_sum(weights)
    mean = (ratios[:, None] + ratios) / 2
    difference = (ratios[:, None] - ratios) / 2

    def find_best(spread: float) -> tf.Tensor:
        prior = (mean / params.common_spread) ** 2 + (difference / spread) ** 2
        joint = score[0][:, None] + score[1] - 0.5 * total * prior
        best = tf.argmax(tf.reshape(joint, [-1]), output_type=tf.int32)
        return tf.stack(
            [tf.gather(ratios, best // params.ratio_steps), tf.gather(ratios, best % params.ratio_steps)]
        )

    return find_best(params.equal_spread), find_best(params.unequal_spread)


@compile_stage
def find_peaks(
    power: tf.Tensor,
    ink: tf.Tensor,
    length: tf.Tensor,
    direction: tf.Tensor,
    factors: tf.Tensor,
    *,
    params: SearchParams,
) -> tf.Tensor:
    """Return the frequencies [N, 2 families, 2] of the strongest waves near the cells' answers.

    The answers are multiplied by exp(`factors` [2]) first.
    """
    ratios = np.linspace(-params.peak_reach, params.peak_reach, 7, dtype=np.float32)
    turns = np.linspace(-1.5 * params.turn_reach, 1.5 * params.turn_reach, 13, dtype=np.float32)
    around = _polar(length, direction, ratios, turns, factors)
    count = length.shape[0]
    flat = tf.reshape(around, [count, 2, -1, 2])
    seen = read_power(power, flat)
    best = tf.argmax(seen, -1, output_type=tf.int32)
    frequency = tf.gather(flat, best, batch_dims=2)
    for _ in range(2):
        waves = measure_waves(ink, frequency)
        frequency += tf.clip_by_value(waves.correction, -1 / SIDE, 1 / SIDE)
    return frequency


def _polar(
    length: tf.Tensor,
    direction: tf.Tensor,
    ratios: np.ndarray,
    turns: np.ndarray,
    factors: tf.Tensor | None = None,
) -> tf.Tensor:
    """Return frequencies [N, 2 families, ratios, turns, 2] around the cells' answers [N]."""
    logs = ratios[None, :] + (tf.zeros([2, 1]) if factors is None else factors[:, None])
    sizes = length[:, None, None] * tf.exp(logs)
    angles = direction[:, None, None] + np.array([0, np.pi / 2], np.float32)[:, None] + turns
    return tf.stack(
        [sizes[..., None] * tf.cos(angles)[:, :, None], sizes[..., None] * tf.sin(angles)[:, :, None]], -1
    )
