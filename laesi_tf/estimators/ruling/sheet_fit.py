"""Fit the sheet to the waves of all windows: frequencies first, then the lines' phases over the whole sheet.

Phases tie all windows together: an error of 0.02 periods in each over a hundred periods is 0.02 % of the
scale, where the frequencies of single windows are good to 0.1 %. Which terms the lines demand is decided by
the marginal likelihood of nested models (Laplace's approximation), so that a flat sheet in an undistorted
photo is fitted by a homography.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.common.sheet_model import COUNT
from laesi_tf.estimators.ruling.least_squares import solve_normal
from laesi_tf.estimators.ruling.params import FitParams
from laesi_tf.estimators.ruling.sheet_waves import (
    Measured,
    masked_median,
    measure,
    predict_waves,
    residuals,
    unwrap,
    window_points,
    wrap,
)
from laesi_tf.estimators.ruling.spectra import Windows
from laesi_tf.estimators.ruling.stage import compile_stage

_STEPS = np.array([0.1] * 2 + [0.5] * 4 + [0.01] * 2 + [0.01] + [0.05] * 2 + [0.01] * 3, np.float32)
"""Differences for the numerical derivatives, by parameter."""
_AFFINE = np.array([1] * 6 + [0] * 8, np.float32)
_FLAT = np.array([1] * 8 + [0] * 6, np.float32)
_LENS = np.array([1] * 9 + [0] * 5, np.float32)
_CROPPED = np.array([1] * 11 + [0] * 3, np.float32)
_BENT = np.array([1] * 8 + [0] * 3 + [1] * 3, np.float32)
_BENT_LENS = np.array([1] * 9 + [0] * 2 + [1] * 3, np.float32)
MODELS = np.stack([_FLAT, _LENS, _CROPPED, _BENT, _BENT_LENS])
"""Which parameters each nested model frees: homography; with k1; with k1 and its centre; with bend; with k1
and bend."""
_FIXED = 1e-4
"""Standard deviation that stands for a parameter that a model does not free."""


class SheetFit(NamedTuple):
    """The fitted sheet."""

    parameters: tf.Tensor
    """[COUNT], as in `SheetModel`."""
    covariance: tf.Tensor
    """[COUNT, COUNT]."""
    model: tf.Tensor
    """Index into MODELS."""
    phase_error: tf.Tensor
    """Median distance of the lines' phases from the fit, periods."""
    windows: tf.Tensor
    """Number of windows in which both families agree with the fit."""
    signal: tf.Tensor
    """[2], median power of each family's waves over the noise."""


def robust_weights(found: tf.Tensor, weight: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return Cauchy weights [N, 2] of the windows' families, and the scale of their residuals.

    `found` [N, 2, 3] are normalised residuals with `weight` [N, 2, 3].
    """
    worst = tf.sqrt(
        tf.reduce_sum(found**2 * weight, -1) / tf.maximum(tf.reduce_sum(tf.sign(weight), -1), 1.0)
    )
    used = weight[..., 0] > 0
    scale = tf.maximum(masked_median(tf.reshape(worst, [-1]), tf.reshape(used, [-1])), 0.3)
    return 1 / (1 + (worst / (2.5 * scale)) ** 2), scale


def step_parameters(
    parameters: tf.Tensor,
    points: tf.Tensor,
    measured: Measured,
    weight: tf.Tensor,
    priors: tf.Tensor,
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Take one Gauss-Newton step of models [M, COUNT].

    Return the new parameters, the normal matrices, and the residuals [M, N, 2, 3] before the step. `weight`
    [N, 2, 3] multiplies squared residuals; `priors` [M, COUNT] are standard deviations about 0.
    """
    models = parameters.shape[0]
    shifts = tf.concat([tf.linalg.diag(_STEPS), -tf.linalg.diag(_STEPS), tf.zeros([1, COUNT])], 0)
    all_waves = predict_waves(parameters[:, None] + shifts, points) / measured.errors
    jacobian = (all_waves[:, :COUNT] - all_waves[:, COUNT : 2 * COUNT]) / (2 * _STEPS[:, None, None, None])
    found = measured.values / measured.errors - all_waves[:, -1]
    rows = tf.reshape(jacobian, [models, COUNT, -1])
    weighted = rows * tf.reshape(weight, [-1])
    precision = 1 / priors**2
    normal = tf.matmul(weighted, rows, transpose_b=True) + tf.linalg.diag(precision)
    right = tf.linalg.matvec(weighted, tf.reshape(found, [models, -1])) - precision * parameters
    change = solve_normal(normal, right[..., None])[0][..., 0]
    return parameters + change, normal, found


@compile_stage
def fit_frequencies(
    start: tf.Tensor, points: tf.Tensor, measured: Measured, rounds: tf.Tensor, *, params: FitParams
) -> tf.Tensor:
    """Fit parameters [COUNT] to the windows' frequencies alone in `rounds` steps, int scalar.

    Lens and bend change as far as their priors let them.
    """
    use = np.array([1, 1, 0], np.float32)
    full = measured.weights[..., None] * use
    windows = tf.reduce_sum(tf.cast(measured.weights > 0, tf.float32)) / 2
    free = tf.where(windows < 4, _AFFINE, tf.where(windows < 8, _FLAT, _BENT_LENS))
    priors = tf.where(free > 0, params.priors, _FIXED)

    def improve(turn: tf.Tensor, parameters: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        weight, _ = robust_weights(residuals(parameters, points, measured), full)
        new, _, _ = step_parameters(
            parameters[None], points, measured, full * weight[..., None], priors[None]
        )
        return turn + 1, new[0]

    return tf.while_loop(lambda turn, _: turn < rounds, improve, (tf.constant(0), start))[1]


@compile_stage
def fit_sheet(
    windows: Windows, noise: tf.Tensor, frequency: tf.Tensor, size: tf.Tensor, *, params: FitParams
) -> SheetFit:
    """Fit the sheet to `windows` with `noise` [N, 2] whose families are near `frequency` [N, 2, 2].

    `size` [2] is the photo's (height, width) in frame pixels.
    """
    points, pixel = window_points(windows, size)
    measured, _ = measure(windows, noise, frequency, params=params.waves)
    share = measured.weights[..., None] / (tf.reduce_sum(measured.weights, 0)[:, None] + 1e-6)
    slopes = tf.reduce_sum(share * measured.values[..., :2], 0) / pixel
    start = tf.concat([tf.zeros([2]), tf.reshape(slopes, [4]), tf.zeros([COUNT - 6])], 0)
    parameters = fit_frequencies(start, points, measured, tf.constant(6), params=params)
    for _ in range(2):
        at = predict_waves(parameters, points)[..., :2]
        measured, _ = measure(windows, noise, at, params=params.waves)
        parameters = fit_frequencies(parameters, points, measured, tf.constant(3), params=params)
    return fit_phases(windows, noise, points, parameters, params=params)


@compile_stage
def _improve_models(
    several: tf.Tensor,
    points: tf.Tensor,
    measured: Measured,
    full: tf.Tensor,
    priors: tf.Tensor,
) -> tuple[tf.Tensor, tf.Tensor]:
    """Take four robust steps of models [M, COUNT].

    Return the models, and the weights [N, 2, 3] by the residuals of the last, richest one.
    """

    def improve(turn: tf.Tensor, models: tf.Tensor, _: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
        weight, _ = robust_weights(residuals(models[-1], points, measured), full)
        weight = full * weight[..., None]
        return turn + 1, step_parameters(models, points, measured, weight, priors)[0], weight

    start = (tf.constant(0), several, full)
    return tf.while_loop(lambda turn, *_: turn < 4, improve, start, maximum_iterations=4)[1:]


@compile_stage
def fit_phases(
    windows: Windows, noise: tf.Tensor, points: tf.Tensor, parameters: tf.Tensor, *, params: FitParams
) -> SheetFit:
    """Fit the phases of all windows from `parameters` [COUNT] that their frequencies were fitted with."""
    middles = windows.middles / windows.step
    # Whole periods mean nothing here, and after a fit of frequencies alone they can be thousands, which would
    # cost digits.
    parameters = tf.concat([parameters[:2] - tf.round(parameters[:2]), parameters[2:]], 0)
    priors = tf.constant(np.where(MODELS > 0, params.priors, _FIXED))
    several = tf.tile(parameters[None], [len(MODELS), 1])
    at = parameters
    for turn in range(2):
        predicted = predict_waves(at, points)
        measured, signal = measure(windows, noise, predicted[..., :2], params=params.waves)
        residual = measured.values - predicted
        if turn == 0:
            phase = unwrap(
                residual[..., 2], residual[..., :2], measured.errors[..., 0], middles, measured.weights
            )
        else:
            phase = wrap(residual[..., 2])
        values = tf.concat([measured.values[..., :2], (predicted[..., 2] + phase)[..., None]], -1)
        measured = measured._replace(values=values)
        full = measured.weights[..., None] * tf.ones([3])
        several, weight = _improve_models(several, points, measured, full, priors)
        at = several[-1]
    chosen, covariance, model = choose_model(several, points, measured, weight, priors, params)
    off = tf.abs(residuals(chosen, points, measured)[..., 2] * measured.errors[..., 2])
    used = measured.weights > 0
    phase_error = masked_median(tf.reshape(off, [-1]), tf.reshape(used, [-1]))
    agree = tf.reduce_all(used & (off < tf.maximum(4 * phase_error, params.agreeing_phase)), 1)
    return SheetFit(
        parameters=chosen,
        covariance=covariance,
        model=model,
        phase_error=phase_error,
        windows=tf.reduce_sum(tf.cast(agree, tf.int32)),
        signal=tf.stack([masked_median(signal[:, f], windows.weights > 0) for f in range(2)]),
    )


def choose_model(
    several: tf.Tensor,
    points: tf.Tensor,
    measured: Measured,
    weight: tf.Tensor,
    priors: tf.Tensor,
    params: FitParams,
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Return parameters [COUNT], covariance and index of the most probable of the fitted models [M, COUNT].

    That is the one with the largest marginal likelihood. The residuals' variance is that of the last, richest
    model.
    """
    several, normal, found = step_parameters(several, points, measured, weight, priors)
    cost = tf.reduce_sum(found**2 * weight, [1, 2, 3])
    rows = tf.reduce_sum(weight)
    variance = tf.maximum(cost[-1] / tf.maximum(rows - COUNT, 3.0), params.least_variance)
    variance *= params.correlation
    inside = tf.linalg.diag(1 / priors**2)
    normal = (normal - inside) / variance + inside
    inverse, log_determinant = solve_normal(normal, tf.eye(COUNT, batch_shape=[several.shape[0]]))
    prior_cost = tf.reduce_sum((several / priors) ** 2, -1)
    log_prior = -2 * tf.reduce_sum(tf.math.log(priors), -1)
    log_evidence = 0.5 * (log_prior - log_determinant - cost / variance - prior_cost)
    best = tf.argmax(log_evidence, output_type=tf.int32)
    return tf.gather(several, best), tf.gather(inverse, best), best
