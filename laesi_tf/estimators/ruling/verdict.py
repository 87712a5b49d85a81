"""Decide whether a reading of a ruling is believed: TensorFlow on scalars, so that an exported graph refuses
the same photos for the same reasons."""

from collections.abc import Sequence

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling.camera_ops import unpack_sheet
from laesi_tf.estimators.ruling.codes import PitchNote, Refusal
from laesi_tf.estimators.ruling.line_levels import FINER
from laesi_tf.estimators.ruling.params import JudgeParams
from laesi_tf.estimators.ruling.reading import Reading


def find_finest_period(reading: Reading) -> tf.Tensor:
    """Return the frame pixels per period of the finest lines that were found, scalar."""
    return reading.votes.period_px / reading.finer.factor


def votes_for_finer(reading: Reading, params: JudgeParams) -> tf.Tensor:
    """Return whether many cells vote for lines between those that were fitted, which may not be excluded."""
    votes, finer = reading.votes, reading.finer
    orders = np.array(FINER, np.float32) / finer.factor
    apart = tf.abs(tf.math.log(votes.period_px / votes.rival_px / orders))
    is_multiple = tf.reduce_any((apart < params.same_period) & ~finer.excluded & (orders > 1))
    return is_multiple & (votes.rival_share > params.rival_share)


def is_before_camera(parameters: tf.Tensor, covariance: tf.Tensor, size: tf.Tensor) -> tf.Tensor:
    """Return whether the fit is finite and the plane's horizon lies outside a photo of `size` [2], (height,
    width)."""
    # Comparisons with NaN are false, and LiteRT has no test for it.
    is_finite = tf.reduce_all(tf.abs(parameters) < 1e30) & tf.reduce_all(tf.abs(covariance) < 1e30)
    sheet = unpack_sheet(parameters)
    down, across = tf.unstack(size / tf.reduce_max(size))
    return is_finite & (tf.abs(sheet.tilt_x) * across + tf.abs(sheet.tilt_y) * down < 1)


def decide_refusal(
    reading: Reading, size: tf.Tensor, grid_mm: tf.Tensor, *, params: JudgeParams
) -> tf.Tensor:
    """Return the first reason in the order of `Refusal` that applies, int32 scalar.

    `size` [2] is the photo's (height, width) in frame pixels; `grid_mm` is the distance of the finest lines
    where the user names it, else 0.
    """
    reading = tf.nest.map_structure(tf.convert_to_tensor, reading)
    votes, fit, finer, heavier = reading
    excluded, is_named = finer.excluded, grid_mm > 0
    weaker, stronger = tf.reduce_min(fit.signal), tf.reduce_max(fit.signal)
    is_millimetre = heavier.fifth & heavier.tenth
    # Without heavier fifths and tenths these may be heavier lines themselves.
    is_plain = ~heavier.fifth & ~heavier.tenth
    halves = heavier.second & ~heavier.fourth
    may_exist = tf.stack([halves | ~excluded[1], halves | ~excluded[2]])
    # Lines at half the distance are the fives of tens that were voted for: finer ones may be drowned still.
    has_no_finer = finer.factor < 2.5
    grid, period = tf.maximum(grid_mm, 1e-3), find_finest_period(reading)
    view_mm = grid * tf.reduce_max(size) / period
    # Lines of which only every fifth or every tenth was seen show a wider view than it seems.
    may_be_heavier = tf.reduce_any(may_exist & (np.array(FINER[1:], np.float32) * view_mm < params.widest_mm))
    is_no_sheet = (fit.windows < params.fewest_windows) | (fit.phase_error > params.worst_phase)
    is_uncertain = may_exist[0] & has_no_finer
    # Beyond what a photo can hold, millimetres of 1-5-10 paper make way for a harmonic of its tens.
    may_be_harmonic = heavier.fifth & ~heavier.tenth & (period < params.surely_finest_px)
    may_be_harmonic &= heavier.surest < params.sure_fifths
    may_be_harmonic |= ~is_millimetre & ~is_plain & ~heavier.are_finest
    reasons = [
        (votes.agreeing_cells < params.fewest_cells, Refusal.NO_RULING),
        ((weaker < params.faintest) & (stronger < 5 * params.faintest), Refusal.NO_RULING),
        (weaker < params.faintest, Refusal.ONE_DIRECTION),
        (is_no_sheet | ~is_before_camera(fit.parameters, fit.covariance, size), Refusal.NOT_A_SHEET),
        (
            is_millimetre & is_named & (tf.abs(tf.math.log(grid)) > params.same_pitch),
            Refusal.CONTRADICTED,
        ),
        (~is_millimetre & votes_for_finer(reading, params), Refusal.FINER_VOTED),
        (may_be_harmonic & ~is_named, Refusal.FINEST_UNCERTAIN),
        (may_be_harmonic & (grid_mm < params.always_finest_mm), Refusal.NAMED_UNCERTAIN),
        (is_plain & ~is_named & is_uncertain, Refusal.FINEST_UNCERTAIN),
        (is_plain & ~is_named, Refusal.PITCH_UNKNOWN),
        (
            is_plain & may_be_heavier & has_no_finer & (grid_mm < params.always_finest_mm),
            Refusal.NAMED_UNCERTAIN,
        ),
    ]
    return choose_first(reasons, Refusal.NONE)


def choose_first(reasons: Sequence[tuple[tf.Tensor, int]], otherwise: int) -> tf.Tensor:
    """Return the code of the first of `reasons`, (whether it applies, code), or `otherwise`; int32 scalar."""
    code = tf.constant(otherwise, tf.int32)
    for applies, reason in reversed(reasons):
        code = tf.where(applies, tf.constant(reason, tf.int32), code)
    return code


def note_pitch(reading: Reading, grid_mm: tf.Tensor) -> tf.Tensor:
    """Return the `PitchNote`, int32 scalar, of lines whose distance the user names as `grid_mm`, or 0."""
    heavier = reading.heavier
    fifth, tenth = tf.convert_to_tensor(heavier.fifth), tf.convert_to_tensor(heavier.tenth)
    note = tf.where(tenth & ~fifth, int(PitchNote.TENTH), int(PitchNote.NONE))
    note = tf.where(fifth & ~tenth, int(PitchNote.FIFTH), note)
    return tf.where(grid_mm > 0, int(PitchNote.NONE), note)


def state_verdict(
    reading: Reading, size: tf.Tensor, grid_mm: tf.Tensor, *, params: JudgeParams
) -> dict[str, tf.Tensor]:
    """Return all that is used of a reading.

    `refusal` and `note` are int32 scalars, see `codes`; `period_px` the frame pixels per period of the finest
    lines; `heavier` int32 [4] by `HEAVIER_LEVELS`; `parameters` [COUNT], `covariance` [COUNT, COUNT] and
    `phase_error` those of the fit; `agreement` [C, C] that of the votes.
    """
    heavier, fit = reading.heavier, reading.fit
    flags = [heavier.second, heavier.fourth, heavier.fifth, heavier.tenth]
    return {
        "refusal": decide_refusal(reading, size, grid_mm, params=params),
        "note": note_pitch(reading, grid_mm),
        "period_px": find_finest_period(reading),
        "heavier": tf.cast(tf.stack(flags), tf.int32),
        "parameters": fit.parameters,
        "covariance": fit.covariance,
        "phase_error": fit.phase_error,
        "agreement": reading.votes.agreement,
    }
