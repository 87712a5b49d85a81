"""What can be seen of a ruling in each cell of a finished image: the labels of the ruling network.

A printed line may be drowned by blur, covered, or lost in JPEG's blocks, so the image itself is asked. The
phase of every printed wave is known; a wave is visible where the image correlates with it much better than
with waves of nearby periods that nobody printed. Not to be compiled: XLA takes four times as long.
"""

import math
from typing import NamedTuple

import numpy as np
import tensorflow as tf

CELL_PX = 16
LEVELS = 3
"""A sheet has fine lines and up to two heavier families at multiples of their distance."""
YES = 1.0
NO = 0.0
UNDECIDED = -1.0
_UNPRINTED = (0.79, 1.27)
"""Frequencies of the waves that are compared with, relative to the printed one; no line's harmonics are
near."""
_FAINTEST = 0.0012
"""Amplitude, on the scale 0..1, that the image's 8 bits leave uncertain; added to the unprinted waves'."""
_CLEAR, _UNCLEAR = 2.5, 1.5
"""A wave this many times above the unprinted ones is visible; below the second number it is hidden."""
_REACHES = ((1, 1), (3, 1), (5, 2))
_REACH_LIMITS_PX = (9.0, 16.0)
"""Waves are sought over so many cells each way, and in so many around the cell itself, for periods up to the
limits and for longer ones."""
_LONGEST_PX = 40.0
"""Lines farther apart are not looked for: coarser levels of a photo's pyramid show them."""
_LOCAL = 0.4
"""The printed wave, in its phase, has this share of its amplitude around a cell where it is visible."""
_HALF_LINE, _HALF_COARSE_LINE = 0.5, 0.3
"""Half the width of what is left out around heavier lines, in fine periods: below 16 px and above."""


class RulingLabels(NamedTuple):
    """Labels of the cells [h, w] of CELL_PX x CELL_PX pixels, each float32.

    `readable`: YES where two crossing families of lines can be seen, NO, or UNDECIDED.
    `finest_uncertain`: YES where lines are printed that are finer than those that can be seen, NO
    where the finest lines can be seen, else UNDECIDED. `log_period` and `log_heaviest`: ln of pixels per
    period of the finest and of the heaviest visible lines, geometric means of both families. `direction`:
    that across the lines, 0..1 in units of 90 degrees.
    """

    readable: tf.Tensor
    finest_uncertain: tf.Tensor
    log_period: tf.Tensor
    log_heaviest: tf.Tensor
    direction: tf.Tensor


def label_ruling(
    image: tf.Tensor, bare_sheet: tf.Tensor, periods_mm: tf.Tensor, lines_mm: tf.Tensor
) -> RulingLabels:
    """Label the cells of `image` uint8 [H, W, 3], H and W multiples of CELL_PX.

    `bare_sheet` [H, W] is 1 where the printed sheet is not covered by a leaf. `periods_mm` [LEVELS] are those
    of the printed lines, 0 for levels that the sheet lacks; `lines_mm` [2, H, W] are the distances of the
    pixels from a line of either direction that belongs to all levels.
    """
    grey = tf.reduce_mean(tf.cast(image, tf.float32), -1) / 255
    cells = _mean_in_cells(tf.concat([lines_mm, tf.cast(bare_sheet, tf.float32)[None]], 0))
    gradients = _gradients(cells[:2])
    log_mm_per_px = 0.25 * tf.reduce_sum(tf.math.log(tf.reduce_sum(gradients**2, 1) + 1e-12), 0)
    levels = [_measure_level(grey, lines_mm, periods_mm, level, log_mm_per_px) for level in range(LEVELS)]
    contrast, share = (tf.stack(part) for part in zip(*levels, strict=True))
    period_px = periods_mm * tf.exp(-tf.reduce_mean(log_mm_per_px))
    is_sought = ((periods_mm > 0) & (period_px < _LONGEST_PX))[:, None, None] & (cells[2] > 0.5)
    seen = is_sought & (contrast > _CLEAR) & (share > _LOCAL)
    is_readable = tf.reduce_any(seen, 0)
    # Faint lines on bare paper may be found or not: what they look like is neither a ruling nor none.
    is_bare_ruling = (cells[2] > 0) & (periods_mm[0] > 0)
    hidden = tf.where(seen[0], NO, tf.where(contrast[0] > _UNCLEAR, UNDECIDED, YES))
    finest = tf.argmax(tf.cast(seen, tf.int32), 0)
    heaviest = LEVELS - 1 - tf.argmax(tf.cast(seen[::-1], tf.int32), 0)
    log_periods = tf.math.log(tf.maximum(periods_mm, 1e-3))
    return RulingLabels(
        readable=tf.where(is_readable, YES, tf.where(is_bare_ruling, UNDECIDED, NO)),
        finest_uncertain=tf.where(is_readable, hidden, UNDECIDED),
        log_period=tf.gather(log_periods, finest) - log_mm_per_px,
        log_heaviest=tf.gather(log_periods, heaviest) - log_mm_per_px,
        direction=_direction(gradients),
    )


def _measure_level(
    grey: tf.Tensor, lines_mm: tf.Tensor, periods_mm: tf.Tensor, level: int, log_mm_per_px: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return how far a level's waves stand out above unprinted ones, and the share of them that is in the
    cell itself: [h, w] each, of the family where it is less."""
    period = tf.maximum(periods_mm[level], 1e-3)
    turns = lines_mm / period
    px_per_mm = tf.exp(-tf.reduce_mean(log_mm_per_px))
    kept = 1 - _near_heavier_lines(lines_mm, periods_mm, level, periods_mm[0] * px_per_mm)
    amplitudes = [
        _correlate(grey, kept, turns * frequency, period * px_per_mm) for frequency in (1.0, *_UNPRINTED)
    ]
    wide, local = amplitudes[0]
    printed = tf.abs(wide)
    unprinted = tf.reduce_mean(tf.stack([tf.abs(other) for other, _ in amplitudes[1:]]), 0)
    share = tf.math.real(local * tf.math.conj(wide)) / (printed**2 + _FAINTEST**2)
    return tf.reduce_min(printed / (unprinted + _FAINTEST), 0), tf.reduce_min(share, 0)


def _near_heavier_lines(
    lines_mm: tf.Tensor, periods_mm: tf.Tensor, level: int, fine_px: tf.Tensor
) -> tf.Tensor:
    """Return 1 [H, W] near heavier lines than those of `level`: they are waves of every multiple of their
    frequency, the fine lines' included. `fine_px` are the pixels per fine period."""
    near = tf.zeros(lines_mm.shape[1:], tf.bool)
    half_mm = periods_mm[0] * tf.where(fine_px > _REACH_LIMITS_PX[-1], _HALF_COARSE_LINE, _HALF_LINE)
    for spacing in tf.unstack(periods_mm)[level + 1 :]:
        turns = lines_mm / tf.maximum(spacing, 1e-3)
        distance = tf.abs(turns - tf.round(turns)) * spacing
        near |= tf.reduce_any((distance < half_mm) & (spacing > 0), 0)
    return tf.cast(near, tf.float32)


def _correlate(
    grey: tf.Tensor, kept: tf.Tensor, turns: tf.Tensor, period_px: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the amplitudes, complex [2, h, w], of waves with phase `turns` [2, H, W] in `grey` where it is
    `kept`: over a neighbourhood that holds several periods, and over the nearest cells."""
    cosine, sine = kept * tf.cos(2 * math.pi * turns), kept * tf.sin(2 * math.pi * turns)
    fields = tf.concat([(kept * grey)[None], kept[None], cosine, sine, grey * cosine, grey * sine], 0)
    cells = _mean_in_cells(fields)
    reach = tf.reduce_sum(tf.cast(period_px > tf.constant(_REACH_LIMITS_PX), tf.int32))
    rows, columns = (tf.gather(tf.constant(_bands(side)), reach) for side in cells.shape[1:])
    wide, local = (rows[kind] @ cells @ tf.transpose(columns[kind]) for kind in range(2))
    return _amplitude(wide), _amplitude(local)


def _amplitude(mean: tf.Tensor) -> tf.Tensor:
    """Return the amplitudes, complex [2, h, w], from the means [10, h, w] of `_correlate`'s fields."""
    share = mean[1] + 1e-3
    level = mean[0] / share
    return tf.complex(
        (mean[6:8] - level * mean[2:4]) / share,
        (mean[8:10] - level * mean[4:6]) / share,
    )


def _mean_in_cells(fields: tf.Tensor) -> tf.Tensor:
    """Average `fields` [n, H, W] over cells: [n, h, w]."""
    rows, columns = (_cell_means(side) for side in fields.shape[1:])
    return tf.matmul(rows, tf.matmul(fields, columns, transpose_b=True))


def _cell_means(side: int) -> np.ndarray:
    """Return the matrix [side / CELL_PX, side] that averages the pixels of each cell along one axis."""
    return np.kron(np.eye(side // CELL_PX), np.full(CELL_PX, 1 / CELL_PX)).astype(np.float32)


def _bands(side: int) -> np.ndarray:
    """Return the matrices [3, 2, side, side] that average entries with neighbours, as _REACHES says."""
    distance = np.abs(np.subtract.outer(np.arange(side), np.arange(side)))
    near = (distance <= np.array(_REACHES)[..., None, None]).astype(np.float32)
    bands: np.ndarray = near / near.sum(-1, keepdims=True)
    return bands


def _gradients(cells: tf.Tensor) -> tf.Tensor:
    """Return the change per pixel, [2 families, 2 (x, y), h, w], of `cells` [2, h, w]."""
    inner = [
        (cells[:, 1:-1, 2:] - cells[:, 1:-1, :-2]) / (2 * CELL_PX),
        (cells[:, 2:, 1:-1] - cells[:, :-2, 1:-1]) / (2 * CELL_PX),
    ]
    return tf.pad(tf.stack(inner, 1), [[0, 0], [0, 0], [1, 1], [1, 1]], "SYMMETRIC")


def _direction(gradients: tf.Tensor) -> tf.Tensor:
    """Return the direction across the lines modulo 90 degrees, in units of 90 degrees: [h, w]."""
    angle = 4 * tf.atan2(gradients[:, 1], gradients[:, 0])
    mean = tf.atan2(tf.reduce_sum(tf.sin(angle), 0), tf.reduce_sum(tf.cos(angle), 0))
    return tf.math.floormod(mean / (2 * math.pi), 1.0)
