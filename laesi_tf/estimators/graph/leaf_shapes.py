"""Tell pens, notes and coins from leaves inside a graph, by the rules of `estimators.mask_estimator`."""

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.graph.close_looks import Found
from laesi_tf.estimators.graph.leaf_measures import find_edges
from laesi_tf.estimators.leaf_outline import LeafOutlineParams

_DIRECTIONS = 180
"""Directions in a right angle, half a degree apart, in which boxes are tried."""


def choose_leaves(found: Found, counts: tf.Tensor, params: LeafOutlineParams) -> tf.Tensor:
    """Return which of several leaves that `counts` [L] are neither pens nor notes, unless there is nothing
    else, nor coins that are smaller than the largest of the others. One leaf stays."""

    def choose() -> tf.Tensor:
        looks_made, looks_round = judge_shapes(found, params)
        natural = counts & ~looks_made
        kept = tf.where(tf.reduce_any(natural), natural, counts)
        largest = tf.reduce_max(tf.where(kept & ~looks_round, found.area, 0.0))
        return kept & (~looks_round | (found.area >= largest))

    is_several = tf.reduce_sum(tf.cast(counts, tf.int32)) > 1
    return tf.cond(is_several, choose, lambda: counts)


def judge_shapes(found: Found, params: LeafOutlineParams) -> tuple[tf.Tensor, tf.Tensor]:
    """Return whether each leaf has the shape of a pen or a note, and whether that of a coin, bool [L]."""
    points, exist = find_edges(found)
    turns = np.pi / 2 * np.arange(2 * _DIRECTIONS) / _DIRECTIONS
    normals = np.stack([np.cos(turns), np.sin(turns)]).astype(np.float32)
    along = tf.matmul(points - points[:, :1], tf.tile(normals[None], [points.shape[0], 1, 1]))
    there = exist[..., None]
    extent = tf.reduce_max(tf.where(there, along, -1e9), 1) - tf.reduce_min(tf.where(there, along, 1e9), 1)
    first, second = extent[:, :_DIRECTIONS], extent[:, _DIRECTIONS:]
    best = tf.argmin(first * second, 1, output_type=tf.int32)
    sides = tf.stack([tf.gather(part, best, batch_dims=1) for part in (first, second)], 1)
    sides = tf.maximum(sides, 1e-3)
    fill = found.area / tf.reduce_prod(sides, 1)
    is_slender = tf.reduce_min(sides, 1) < params.pen_max_aspect * tf.reduce_max(sides, 1)
    looks_made = (is_slender & (fill > params.pen_min_fill)) | (fill > params.note_min_fill)
    return looks_made, _looks_like_coin(found, points, exist, params)


def _looks_like_coin(
    found: Found, points: tf.Tensor, exist: tf.Tensor, params: LeafOutlineParams
) -> tf.Tensor:
    """Return whether the edges `points` [L, N, 2] lie on the ellipse with the leaf's second moments."""
    side = found.leaf.shape[1]
    own = tf.cast(found.leaf >= 0.5, tf.float32)
    own /= tf.maximum(tf.reduce_sum(own, [1, 2], keepdims=True), 1.0)
    places = np.arange(side, dtype=np.float32) + 0.5
    pixel = tf.maximum(found.square[:, 2], 1e-3) / side
    columns, rows = tf.reduce_sum(own, 1), tf.reduce_sum(own, 2)
    x, y = (tf.reduce_sum(part * places, 1) for part in (columns, rows))
    xx = tf.reduce_sum(columns * (places - x[:, None]) ** 2, 1)
    yy = tf.reduce_sum(rows * (places - y[:, None]) ** 2, 1)
    half = tf.reduce_sum(own * (places - y[:, None])[:, :, None], 1)
    xy = tf.reduce_sum(half * (places - x[:, None]), 1)
    determinant = tf.maximum(xx * yy - xy**2, 1e-9)
    mean, spread = (xx + yy) / 2, tf.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    aspect = tf.sqrt(tf.maximum(mean - spread, 0.0) / tf.maximum(mean + spread, 1e-9))
    dx, dy = (
        (points[..., axis] - found.square[:, axis, None]) / pixel[:, None] - middle[:, None]
        for axis, middle in ((0, x), (1, y))
    )
    # Half the axes of an ellipse are twice the standard deviations.
    squares = (yy[:, None] * dx**2 - 2 * xy[:, None] * dx * dy + xx[:, None] * dy**2) / determinant[:, None]
    radii = tf.sqrt(tf.maximum(squares, 0.0)) / 2
    weights = tf.cast(exist, tf.float32)
    weights /= tf.maximum(tf.reduce_sum(weights, 1, keepdims=True), 1.0)
    radius = tf.reduce_sum(weights * radii, 1, keepdims=True)
    deviation = tf.sqrt(tf.reduce_sum(weights * (radii - radius) ** 2, 1))
    return (aspect >= params.coin_min_aspect) & (deviation < params.coin_max_deviation)
