"""Spectra of patches of a picture: where in the frequency plane each patch has its power.

A spectrum is [ROWS, COLUMNS]: row r holds the frequency r - ROWS / 2 along y, column c the frequency c - MARGIN
along x, in BINS-ths of a period per pixel. The other half plane mirrors this one.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

SIDE = 192
"""Side of a patch, pixels."""
BINS = 256
"""Patches are padded to this side: TFLite transforms powers of two only, and peaks are interpolated better."""
MARGIN = 15
ROWS, COLUMNS = BINS, BINS // 2 + 1 + MARGIN
_WINDOW = np.hanning(SIDE + 2)[1:-1].astype(np.float32)
_WINDOW = _WINDOW[:, None] * _WINDOW


class Spectra(NamedTuple):
    """Log-power of patches [K, ROWS, COLUMNS], its local `level`, and how far it or a neighbour stands out."""

    loud: tf.Tensor
    level: tf.Tensor
    prominence: tf.Tensor
    centres: tf.Tensor
    """[K, 2] in units of `half` pixels from the picture's middle."""
    valid: tf.Tensor
    """float [K], 0 for patches that show no paper."""
    bins: tf.Tensor
    """[K], bins per period per unit: patches differ in resolution."""

    def read(self, values: tf.Tensor, frequency: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        """`values` [K, ROWS, COLUMNS] nearest to frequencies [B, K, ..., 2], periods per unit; and where they are
        within the spectrum, bool [B, K, ...]."""
        extra = [1] * (frequency.shape.rank - 2)
        place = upright(frequency * tf.reshape(self.bins, [1, -1, *extra]))[0]
        column, row = tf.unstack(tf.cast(tf.round(place), tf.int32), axis=-1)
        inside = within(place, 3.0) & (tf.norm(place, axis=-1) > 3.5)
        patch = tf.reshape(tf.range(values.shape[0]), [1, -1, *extra[1:]])
        return at(values, patch, tf.where(inside, row, 0), tf.where(inside, column, 0)), inside


def upright(frequency: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Frequencies [..., 2] turned into the half plane that spectra hold, and the signs [..., 1] that did it."""
    sign = tf.where(frequency[..., :1] < 0, -1.0, 1.0)
    return frequency * sign, sign


def within(place: tf.Tensor, margin: tf.Tensor | float) -> tf.Tensor:
    """Whether frequencies [..., 2] in bins keep `margin` bins from the end of the spectrum."""
    return tf.reduce_max(tf.abs(place), axis=-1) < BINS // 2 - 1 - margin


def at(values: tf.Tensor, patch: tf.Tensor, row: tf.Tensor, column: tf.Tensor) -> tf.Tensor:
    """`values` [K, ROWS, COLUMNS] at bins that count from frequency 0."""
    flat = (patch * ROWS + row + ROWS // 2) * COLUMNS + column + MARGIN
    return tf.gather(tf.reshape(values, [-1]), flat)


def spectra(detail: tf.Tensor, centres: tf.Tensor, valid: tf.Tensor, bins: tf.Tensor) -> Spectra:
    """The spectra of flattened patches [K, SIDE, SIDE]; the rest as in `Spectra`."""
    windowed = (detail - tf.reduce_mean(detail, axis=[1, 2], keepdims=True)) * _WINDOW
    padded = tf.pad(windowed, [[0, 0], [0, BINS - SIDE], [0, BINS - SIDE]])
    transformed = tf.signal.rfft2d(padded, [BINS, BINS])
    power = tf.math.real(transformed) ** 2 + tf.math.imag(transformed) ** 2
    loud = _centred(tf.math.log(power + 1e-3))
    level = local_mean(loud, 3)
    highest = tf.nn.max_pool2d(loud[..., None], 3, 1, "SAME")[..., 0]
    return Spectra(loud, level, tf.nn.relu(highest - level - 1), centres, valid, bins)


def _centred(values: tf.Tensor) -> tf.Tensor:
    """Half planes [K, BINS, BINS / 2 + 1] as a transform leaves them to [K, ROWS, COLUMNS]."""
    right = tf.concat([values[:, BINS // 2 :], values[:, : BINS // 2]], axis=1)
    # Row r mirrors row BINS - r; the first, the highest frequency, is its own mirror.
    mirrored = tf.reverse(right[:, :, 1 : MARGIN + 1], axis=[1, 2])
    left = tf.concat([mirrored[:, -1:], mirrored[:, :-1]], axis=1)
    return tf.concat([left, right], axis=2)


def local_mean(values: tf.Tensor, cells: int, cell: int = 4) -> tf.Tensor:
    """Mean of [K, h, w] over squares of `cells` x `cells` cells of `cell` pixels, interpolated between them."""
    coarse = tf.nn.avg_pool2d(values[..., None], cell, cell, "VALID")
    coarse = tf.nn.avg_pool2d(coarse, cells, 1, "SAME")
    return tf.image.resize(coarse, values.shape[1:])[..., 0]
