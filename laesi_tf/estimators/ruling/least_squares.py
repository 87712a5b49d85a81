"""Small linear systems by explicit elimination: LiteRT has no solver."""

import tensorflow as tf


def solve_normal(matrix: tf.Tensor, columns: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Solve symmetric positive definite systems [..., P, P] for `columns` [..., P, K].

    Return the solutions [..., P, K] and ln of the determinants [...]. Gauss-Jordan without pivoting, on the
    system scaled to a unit diagonal.
    """
    count = matrix.shape[-1]
    scale = tf.sqrt(tf.maximum(tf.reduce_sum(matrix * tf.eye(count), -1), 1e-30))
    work = tf.concat([matrix / scale[..., :, None] / scale[..., None, :], columns / scale[..., :, None]], -1)
    log_determinant = 2 * tf.reduce_sum(tf.math.log(scale), -1)
    # Unrolled: a loop of so small steps would cost more in overhead than in arithmetic.
    for index in range(count):
        pivot = tf.maximum(work[..., index : index + 1, index : index + 1], 1e-7)
        log_determinant += tf.math.log(pivot[..., 0, 0])
        factor = work[..., :, index : index + 1] - tf.one_hot(index, count)[:, None]
        work = work - factor * (work[..., index : index + 1, :] / pivot)
    return work[..., count:] / scale[..., :, None], log_determinant
