"""Peaks of spectra near the frequencies that a lattice predicts, measured in all patches at once."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling_reader.lattice import Peaks, fit_to_peaks, lattice_frequencies
from laesi_tf.estimators.ruling_reader.spectra import BINS, Spectra, gather_bins, is_inside, to_half_plane

_MIN_PROMINENCE, _MAX_PROMINENCE = 2.0, 6.0
"""Log-power of a peak over its surroundings: the least, and the value above which its weight is constant."""
_NEAREST = 2.7
"""Least reach of the search, bins."""


def grow_lattices(
    spectra: Spectra, lattice: tf.Tensor, start: tf.Tensor, stages: tuple[tuple[float, float], ...]
) -> tuple[tf.Tensor, tf.Tensor]:
    """Fit lattices [B, 6] in stages of (reach from `start` [B, 2], tolerance of peaks).

    Also returns bool [B]: whether every stage had enough peaks.
    """
    distance = tf.norm(spectra.centres[None] - start[:, None], axis=-1)
    good = tf.ones_like(lattice[:, 0]) > 0
    for reach, tolerance in stages:
        peaks = measure_peaks(spectra, lattice, tolerance)
        weight = peaks.weight * tf.cast(distance <= reach, tf.float32)[..., None]
        lattice = fit_to_peaks(lattice, spectra.centres, Peaks(peaks.at, weight))
        good &= tf.reduce_sum(tf.cast(weight > 0, tf.float32), axis=[1, 2]) >= 4
    return lattice, good


def measure_peaks(spectra: Spectra, lattice: tf.Tensor, tolerance: float) -> Peaks:
    """Measure the highest peaks within a relative `tolerance` of the frequencies of lattices [B, 6]."""
    bins = spectra.bins[:, None, None]
    expected = lattice_frequencies(lattice, spectra.centres) * bins
    place, sign = to_half_plane(expected)
    reach = tf.maximum(_NEAREST, tolerance * tf.norm(place, axis=-1))
    inside = is_inside(place, reach + 1)
    nearest = tf.cast(tf.round(tf.where(inside[..., None], place, 0)), tf.int32)
    offsets = _window(tolerance)
    patch = tf.range(spectra.power.shape[0])[None, :, None]
    column, row = nearest[..., 0], nearest[..., 1]
    seen = gather_bins(
        spectra.power, patch[..., None], row[..., None] + offsets[:, 1], column[..., None] + offsets[:, 0]
    )
    away = tf.cast(nearest, tf.float32)[..., None, :] + offsets.astype(np.float32) - place[..., None, :]
    near = tf.norm(away, axis=-1) <= reach[..., None]
    best = tf.gather(offsets, tf.argmax(tf.where(near, seen, -1e9), axis=-1, output_type=tf.int32))
    column, row = column + best[..., 0], row + best[..., 1]
    height = gather_bins(spectra.power, patch, row, column)
    above = height - gather_bins(spectra.level, patch, row, column)
    shift = tf.stack(
        [
            _interpolate_vertex(
                gather_bins(spectra.power, patch, row, column - 1),
                height,
                gather_bins(spectra.power, patch, row, column + 1),
            ),
            _interpolate_vertex(
                gather_bins(spectra.power, patch, row - 1, column),
                height,
                gather_bins(spectra.power, patch, row + 1, column),
            ),
        ],
        axis=-1,
    )
    peak = (tf.cast(tf.stack([column, row], axis=-1), tf.float32) + shift) * sign / bins
    found = inside & (above >= _MIN_PROMINENCE)
    weight = tf.where(found, tf.minimum(above, _MAX_PROMINENCE), 0) * spectra.valid[:, None]
    return Peaks(peak, weight)


def _window(tolerance: float) -> np.ndarray:
    """Return the offsets int [n, 2] of the bins within the widest reach."""
    radius = math.ceil(max(_NEAREST, min(tolerance * BINS / 2, 14)))
    steps = np.arange(-radius, radius + 1, dtype=np.int32)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return grid[np.hypot(*grid.T) <= radius + 1]


def _interpolate_vertex(before: tf.Tensor, middle: tf.Tensor, after: tf.Tensor) -> tf.Tensor:
    """Return the offset of the vertex of the parabola through three samples from the middle one."""
    curvature = before - 2 * middle + after
    offset = (before - after) / tf.minimum(2 * curvature, -1e-6)
    return tf.clip_by_value(tf.where(curvature < 0, offset, 0), -0.6, 0.6)
