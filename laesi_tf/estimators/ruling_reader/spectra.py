"""Spectra of patches of an image: the power of each patch over the frequency plane.

A spectrum is [BINS, COLUMNS] as the transform leaves it: row r holds the frequency r along y, or r - BINS
from the middle on, column c the frequency c along x, in BINS-ths of a period per pixel. The other half
plane mirrors this one.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

SIDE = 192
"""Side of a patch, pixels."""
BINS = 256
"""Patches are padded to this side: TFLite transforms powers of two only, and peaks are finer."""
COLUMNS = BINS // 2 + 1
_WINDOW = np.hanning(SIDE + 2)[1:-1].astype(np.float32)
_WINDOW = _WINDOW[:, None] * _WINDOW


class Spectra(NamedTuple):
    """Log-power of patches [K, BINS, COLUMNS] and its local `level`."""

    power: tf.Tensor
    level: tf.Tensor
    centres: tf.Tensor
    """[K, 2] in units of `half` pixels from the middle of the photo."""
    valid: tf.Tensor
    """float [K], 0 for patches that show no paper."""
    bins: tf.Tensor
    """[K], bins per period per unit: patches differ in resolution."""

    def read(self, frequency: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
        """Return log-power and prominence [B, K, ...] at frequencies [B, K, ..., 2], periods per unit.

        Also where they are within the spectrum, bool.
        """
        extra = [1] * (frequency.shape.rank - 2)
        place = to_half_plane(frequency * tf.reshape(self.bins, [1, -1, *extra]))[0]
        inside = is_inside(place, 3.0) & (tf.norm(place, axis=-1) > 3.5)
        column, row = tf.unstack(
            tf.cast(tf.round(tf.where(inside[..., None], place, 0.0)), tf.int32), axis=-1
        )
        patch = tf.reshape(tf.range(self.power.shape[0]), [1, -1, *extra[1:]])
        around = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2).astype(np.int32)
        seen = gather_bins(
            self.power, patch[..., None], row[..., None] + around[:, 1], column[..., None] + around[:, 0]
        )
        highest = tf.reduce_max(seen, axis=-1)
        return seen[..., 4], compute_prominence(highest, gather_bins(self.level, patch, row, column)), inside


def compute_prominence(highest: tf.Tensor, level: tf.Tensor) -> tf.Tensor:
    """Return the log-power of a frequency or its best neighbour over its surroundings, at least 0."""
    return tf.nn.relu(highest - level - 1)


def compute_prominences(spectra: Spectra, stride: int) -> tf.Tensor:
    """Return the prominence [K / stride, BINS, COLUMNS] of every `stride`-th patch, 0 where not valid."""
    power = spectra.power[::stride]
    highest = tf.nn.max_pool2d(power[..., None], 3, 1, "SAME")[..., 0]
    return compute_prominence(highest, spectra.level[::stride]) * spectra.valid[::stride, None, None]


def to_half_plane(frequency: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return frequencies [..., 2] mirrored into the half plane of the spectra, and the signs [..., 1]."""
    sign = tf.where(frequency[..., :1] < 0, -1.0, 1.0)
    return frequency * sign, sign


def is_inside(place: tf.Tensor, margin: tf.Tensor | float) -> tf.Tensor:
    """Return whether frequencies [..., 2] in bins keep `margin` bins from the end of the spectrum."""
    return tf.reduce_max(tf.abs(place), axis=-1) < BINS // 2 - 1 - margin


def gather_bins(values: tf.Tensor, patch: tf.Tensor, row: tf.Tensor, column: tf.Tensor) -> tf.Tensor:
    """Return `values` [K, BINS, COLUMNS] at frequencies of -BINS / 2 < `row`, `column` < BINS / 2 bins."""
    row = tf.where(column < 0, -row, row)
    row = tf.where(row < 0, row + BINS, row)
    return tf.gather(tf.reshape(values, [-1]), (patch * BINS + row) * COLUMNS + tf.abs(column))


def compute_spectra(detail: tf.Tensor, centres: tf.Tensor, valid: tf.Tensor, bins: tf.Tensor) -> Spectra:
    """Return the spectra of flattened patches [K, SIDE, SIDE]; the rest as in `Spectra`."""
    windowed = (detail - tf.reduce_mean(detail, axis=[1, 2], keepdims=True)) * _WINDOW
    padded = tf.pad(windowed, [[0, 0], [0, BINS - SIDE], [0, BINS - SIDE]])
    transformed = tf.signal.rfft2d(padded, [BINS, BINS])
    power = 2 * tf.math.log(tf.abs(transformed) + 0.03)
    return Spectra(power, local_mean(power, 3), centres, valid, bins)


def local_mean(values: tf.Tensor, cells: int, cell: int = 4) -> tf.Tensor:
    """Return the mean of [K, h, w] over squares of `cells` x `cells` cells of `cell` pixels, interpolated."""
    coarse = tf.nn.avg_pool2d(values[..., None], cell, cell, "VALID")
    coarse = tf.nn.avg_pool2d(coarse, cells, 1, "SAME")
    return tf.image.resize(coarse, values.shape[1:])[..., 0]
