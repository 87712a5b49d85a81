"""Square lattices in perspective, and their fit to frequencies measured in patches.

A lattice is [..., 6]: (a, b, d, e, g, h) maps a point (u, v), in units of half the picture's longer side
from its middle, to the sheet's coordinates X = (a u + b v) / w and Y = (d u + e v) / w, w = g u + h v + 1,
in periods of the ruling. Its two families of lines have the gradients of X and Y for frequencies, periods
per unit.
"""

from typing import NamedTuple

import tensorflow as tf

_ROUNDS = 3
"""Gauss-Newton converges in three to four iterations from a start within a tenth, and fits are repeated."""
MAX_PERSPECTIVE = 0.4
"""Bound of a lattice's change of scale to the border, twice that of a tilt of 20 degrees: nothing in
the photo is then behind the camera."""
_RIDGE = 1e-5


class Peaks(NamedTuple):
    """Frequencies measured in the patches: `at` [B, K, 2 families, 2] and `weight` [B, K, 2], 0 for none."""

    at: tf.Tensor
    weight: tf.Tensor


def lattice_frequencies(lattice: tf.Tensor, centres: tf.Tensor) -> tf.Tensor:
    """Return the frequencies [B, K, 2 families, 2] of lattices [B, 6] at `centres` [K, 2]."""
    return _linearise(lattice, centres)[0]


def rescale(lattice: tf.Tensor, factors: tf.Tensor) -> tf.Tensor:
    """Return lattices [..., 6] with their lines taken for families `factors` [..., 2] times as fine."""
    ones = tf.ones_like(factors)
    return lattice * tf.concat([tf.repeat(factors, 2, axis=-1), ones], axis=-1)


def rates(lattice: tf.Tensor) -> tf.Tensor:
    """Return the periods per unit [..., 2] along u and v of lattices [..., 6] in the middle of the photo."""
    a, b, d, e, _, _ = tf.unstack(lattice, axis=-1)
    return tf.sqrt(tf.stack([a * a + d * d, b * b + e * e], axis=-1))


def rate(lattice: tf.Tensor) -> tf.Tensor:
    """Return the periods per unit [...] in the middle of the photo, geometric mean over directions."""
    a, b, d, e, _, _ = tf.unstack(lattice, axis=-1)
    return tf.sqrt(tf.abs(a * e - b * d))


def fit_to_peaks(lattice: tf.Tensor, centres: tf.Tensor, peaks: Peaks) -> tf.Tensor:
    """Fit lattices [B, 6] to the peaks of the patches at `centres` [K, 2].

    Gauss-Newton with robust (Cauchy) weights on the relative error of the frequencies. Without peaks in at
    least five patches the perspective is left alone.
    """
    several = tf.reduce_sum(tf.cast(tf.reduce_any(peaks.weight > 0, axis=2), tf.float32), axis=1) >= 5
    free = tf.concat(
        [tf.ones_like(lattice[:, :4]), tf.repeat(tf.cast(several, tf.float32)[:, None], 2, 1)], 1
    )
    size = tf.norm(peaks.at, axis=-1, keepdims=True) + 1e-9
    scale = tf.sqrt(peaks.weight[..., None]) / size
    for _ in range(_ROUNDS):
        predicted, jacobian = _linearise(lattice, centres)
        residual = (predicted - peaks.at) * scale
        error = tf.norm(residual, axis=-1)
        width = tf.maximum(1.5 * median(error, peaks.weight > 0), 1e-3)[:, None, None]
        robust = (scale / tf.sqrt(1 + (error / width) ** 2)[..., None])[..., None]
        rows = tf.reshape(jacobian * robust, [lattice.shape[0], -1, 6]) * free[:, None]
        right = tf.reshape((predicted - peaks.at) * robust[..., 0], [lattice.shape[0], -1, 1])
        normal = tf.matmul(rows, rows, transpose_a=True)
        lattice -= solve(normal, tf.matmul(rows, right, transpose_a=True)[..., 0]) * free
        bounded = tf.clip_by_value(lattice[:, 4:], -MAX_PERSPECTIVE, MAX_PERSPECTIVE)
        lattice = tf.concat([lattice[:, :4], bounded], axis=1)
    return lattice


def median(values: tf.Tensor, valid: tf.Tensor) -> tf.Tensor:
    """Return the median [B] of `values` [B, ...] where `valid`; 0 where nothing is."""
    batch = values.shape[0]
    flat = tf.reshape(tf.where(valid, values, -1.0), [batch, -1])
    falling = tf.math.top_k(flat, flat.shape[1]).values
    middle = tf.reduce_sum(tf.cast(tf.reshape(valid, [batch, -1]), tf.int32), axis=1) // 2
    return tf.maximum(tf.gather(falling, middle, batch_dims=1), 0)


def solve(matrix: tf.Tensor, right: tf.Tensor) -> tf.Tensor:
    """Solve positive semidefinite systems [B, n, n] x = [B, n] by Gauss-Jordan elimination with a ridge.

    Scaled to a unit diagonal first, no pivoting is needed.
    """
    n = matrix.shape[-1]
    size = tf.sqrt(tf.reduce_sum(matrix * tf.eye(n), axis=2)) + 1e-9
    augmented = tf.concat([matrix / (size[:, :, None] * size[:, None, :]), (right / size)[..., None]], axis=2)
    augmented += tf.constant([[_RIDGE if i == j else 0.0 for j in range(n + 1)] for i in range(n)])
    for k in range(n):
        pivot = augmented[:, k : k + 1] / augmented[:, k : k + 1, k : k + 1]
        this = tf.constant([[[i == k] for i in range(n)]])
        augmented = tf.where(this, pivot, augmented - augmented[:, :, k : k + 1] * pivot)
    return augmented[..., n] / size


def _linearise(lattice: tf.Tensor, centres: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return frequencies [B, K, 2, 2] and their derivatives [B, K, 2, 2, 6] by the lattice's numbers."""
    a, b, d, e, g, h = tf.unstack(lattice[:, None], axis=-1)
    u, v = tf.unstack(centres, axis=-1)
    w = 1 / (g * u + h * v + 1)
    tilt = tf.stack([g + 0 * w, h + 0 * w], axis=-1)
    point = tf.stack([u + 0 * w, v + 0 * w], axis=-1)
    found, slopes = [], []
    for place, (p, q) in enumerate(((a, b), (d, e))):
        at = (p * u + q * v) * w
        frequency = (tf.stack([p + 0 * at, q + 0 * at], axis=-1) - at[..., None] * tilt) * w[..., None]
        # d frequency / d (p, q) and d frequency / d (g, h): [B, K, 2, 2].
        own = (tf.eye(2) - tilt[..., :, None] * (point * w[..., None])[..., None, :]) * w[..., None, None]
        shared = -at[..., None, None] * own - frequency[..., :, None] * (point * w[..., None])[..., None, :]
        found.append(frequency)
        none = tf.zeros_like(own)
        slopes.append(tf.concat([own, none, shared] if place == 0 else [none, own, shared], axis=-1))
    return tf.stack(found, axis=2), tf.stack(slopes, axis=2)
