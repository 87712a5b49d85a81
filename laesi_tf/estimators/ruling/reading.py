"""Read the ruling of a photo from the network's answers: votes, windows, spectra, fit, as one TensorFlow
function."""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.common.sheet_model import COUNT
from laesi_tf.estimators.ruling.line_levels import (
    HALF,
    NO_FINER_LINES,
    FinerLines,
    HeavierLines,
    find_coarser,
    find_finer,
    find_heavier,
)
from laesi_tf.estimators.ruling.params import LevelParams, ReadingParams, VoteParams
from laesi_tf.estimators.ruling.sheet_fit import SheetFit, fit_phases, fit_sheet
from laesi_tf.estimators.ruling.sheet_waves import predict_waves, window_points
from laesi_tf.estimators.ruling.spectra import (
    SIDE,
    Pyramid,
    Windows,
    compute_power,
    cut_windows,
    extract_ink,
    find_families,
    find_peaks,
    measure_noise,
)
from laesi_tf.estimators.ruling.stage import compile_stage
from laesi_tf.estimators.ruling.votes import Votes, choose_windows
from laesi_tf.models.ruling_cells import CELL_PX, LEVELS

WINDOWS = 32
_GRID = np.stack(np.meshgrid(*[np.arange(4, SIDE, 8, dtype=np.float32) - SIDE / 2] * 2), -1)
"""[16, 16, 2], places in a window, pixels from its middle."""


class Reading(NamedTuple):
    """What the lines of a photo say."""

    votes: Votes
    fit: SheetFit
    """In periods of the finest lines that were found."""
    finer: FinerLines
    """Relative to the lines that the cells voted for; the fit contains the factor already."""
    heavier: HeavierLines


def choose_level(period: tf.Tensor, size: tf.Tensor, params: ReadingParams) -> tf.Tensor:
    """Return the pyramid level, int scalar, at which to measure lines of `period` frame pixels.

    `size` [2] is that of the photo.
    """
    level = tf.math.ceil(tf.math.log(period / params.coarsest_px) / tf.math.log(2.0))
    room = tf.floor(tf.math.log(tf.reduce_min(size) / params.room_px) / tf.math.log(2.0))
    return tf.cast(tf.clip_by_value(tf.minimum(level, room), 0.0, LEVELS - 1.0), tf.int32)


def choose_surer(
    one: tuple[SheetFit, HeavierLines], other: tuple[SheetFit, HeavierLines], params: LevelParams
) -> tuple[SheetFit, HeavierLines]:
    """Return the surer of two fits.

    That is `other` where both of its families show heavier lines and not both of `one` do, or where it alone
    has both families at all.
    """
    (fit, heavier), (other_fit, other_heavier) = one, other
    is_faint = tf.reduce_min(fit.signal) < 0.25 * tf.reduce_min(other_fit.signal)
    is_surer = other_heavier.surest > tf.maximum(params.heavy, 2 * heavier.surest)
    return tf.cond(is_surer | is_faint, lambda: other, lambda: one)


def is_halved(heavier: HeavierLines) -> tf.Tensor:
    """Return whether the fitted waves are first harmonics of the printed lines, bool scalar."""
    return tf.reduce_max(heavier.factors) < (1 + HALF) / 2


def sample_cells(field: tf.Tensor, points: tf.Tensor) -> tf.Tensor:
    """Return `field` [C, C] of the frame's cells at `points` [..., 2] in frame pixels, nearest cell."""
    side = field.shape[0]
    # Clipped as integers: a point that is not finite is no index.
    cell = tf.clip_by_value(tf.cast(points / CELL_PX, tf.int32), 0, side - 1)
    return tf.gather(tf.reshape(field, [-1]), cell[..., 1] * side + cell[..., 0])


@compile_stage
def prepare_windows(
    pyramid: Pyramid, size: tf.Tensor, votes: Votes, level: tf.Tensor, *, params: VoteParams
) -> Windows:
    """Cut the windows of pyramid `level` where cells agree with the votes."""
    middles, weights = choose_windows(votes, size, level=level, count=WINDOWS, side_px=SIDE, params=params)
    pixels = cut_windows(pyramid, level, middles, size)
    step = tf.pow(2.0, tf.cast(level, tf.float32))
    ruled = sample_cells(cover_ruling(votes.agreement), middles[:, None, None] + step * _GRID)
    return Windows(extract_ink(pixels, weights, ruled), middles, weights, step)


@compile_stage
def predict_in(windows: Windows, size: tf.Tensor, parameters: tf.Tensor) -> tf.Tensor:
    """Return the waves [N, 2, 3] that `parameters` [COUNT] predict in `windows` of a photo of `size` [2]."""
    return predict_waves(parameters, window_points(windows, size)[0])


def cover_ruling(agreement: tf.Tensor) -> tf.Tensor:
    """Return where the ruling is, 0..1 [C, C].

    That is `agreement` [C, C] with single holes filled and cells that only border on it left out.
    """
    mean = tf.nn.avg_pool2d(agreement[None, ..., None], 3, 1, "SAME")[0, ..., 0]
    return tf.clip_by_value(2.5 * mean - 0.9, 0.0, 1.0)


def read_sheet(pyramid: Pyramid, size: tf.Tensor, votes: Votes, *, params: ReadingParams) -> Reading:
    """Read the ruling of a photo in the corner of a frame, RGB of 0..255, of which `pyramid` has all LEVELS.

    `size` [2] is the photo's (height, width), float; `votes` are those of the cells of its pyramid.
    """
    level = choose_level(votes.period_px, size, params)
    windows = prepare_windows(pyramid, size, votes, level, params=params.votes)
    power = compute_power(windows.ink)
    length = windows.step / tf.exp(sample_cells(votes.log_period, windows.middles))
    direction = sample_cells(votes.direction, windows.middles)

    def fit_families(factors: tf.Tensor) -> tuple[SheetFit, HeavierLines]:
        frequency = find_peaks(power, windows.ink, length, direction, factors, params=params.search)
        noise = measure_noise(power, length[:, None] * tf.exp(factors))
        fit = fit_sheet(windows, noise, frequency, size, params=params.fit)
        return fit, find_heavier(windows, predict_in(windows, size, fit.parameters), params=params.levels)

    square, stretched = find_families(power, windows.weights, length, direction, params=params.search)
    fit, heavier = fit_families(square)
    fit, heavier = tf.cond(
        (tf.reduce_max(tf.abs(square - stretched)) > params.same_factors)
        & (heavier.surest < params.levels.heavy),
        lambda: choose_surer((fit, heavier), fit_families(stretched), params.levels),
        lambda: (fit, heavier),
    )
    coarser = find_coarser(windows, predict_in(windows, size, fit.parameters), params=params.levels)
    is_coarser = coarser > 1.5
    is_harmonic = tf.reduce_any(tf.abs(heavier.factors - 1) > 0.1) | is_coarser

    # Lines of which every fifth or tenth is heavier are the finest already.
    is_finest = is_harmonic | heavier.fifth | heavier.tenth
    fine_level = choose_level(votes.period_px / 5, size, params)
    fine = tf.cond(
        ~is_finest & (fine_level < level),
        lambda: prepare_windows(pyramid, size, votes, fine_level, params=params.votes),
        lambda: windows,
    )
    fine = Windows(*(tf.ensure_shape(new, old.shape) for new, old in zip(fine, windows, strict=True)))
    finer = tf.cond(
        is_finest,
        lambda: NO_FINER_LINES,
        lambda: find_finer(fine, predict_in(fine, size, fit.parameters), params=params.levels),
    )
    factor = finer.factor
    used = Windows(*(tf.where(is_harmonic, old, new) for old, new in zip(windows, fine, strict=True)))

    def refit(parameters: tf.Tensor, scale: tf.Tensor) -> tuple[SheetFit, HeavierLines]:
        """Fit again with lines that are finer by `scale` [2 families]."""
        u, v = scale[0], scale[1]
        scaled = parameters * tf.concat([tf.stack([u, v, u, u, v, v]), tf.ones([COUNT - 6])], 0)
        lengths = tf.norm(predict_in(used, size, scaled)[..., :2], axis=-1)
        noise = measure_noise(compute_power(used.ink), lengths)
        again = fit_phases(used, noise, window_points(used, size)[0], scaled, params=params.fit)
        return again, find_heavier(used, predict_in(used, size, again.parameters), params=params.levels)

    halved = is_halved(heavier)
    scale = heavier.factors * factor / coarser
    fit, heavier = tf.cond(
        is_harmonic | (factor > 1.5), lambda: refit(fit.parameters, scale), lambda: (fit, heavier)
    )
    # Finer lines that were found may be the first harmonic of the finest.
    halved_again = is_halved(heavier)
    fit, heavier = tf.cond(
        halved_again, lambda: refit(fit.parameters, heavier.factors), lambda: (fit, heavier)
    )
    factor = factor / coarser * tf.where(halved, HALF, 1.0) * tf.where(halved_again, HALF, 1.0)
    finer = finer._replace(factor=factor, excluded=finer.excluded | is_coarser)
    return Reading(votes, fit, finer, heavier)
