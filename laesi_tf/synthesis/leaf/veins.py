"""Veins by turtle graphics (paper, section 3.2, after Goldman et al. 2004).

A turtle follows a list of (turn, forward) commands; its path is the cumulative sum of its steps, so all
turtles of a leaf walk at once. One turtle walks the midrib; secondary turtles leave it at random angles
theta, curve towards the tip, jitter by Brownian motion Bm(t), and taper. Their strokes are filled like any
polygon.
"""

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis.geometry import polygon_edges, stroke_outlines
from laesi_tf.synthesis.leaf.outline import midrib
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.ranges import Scalar

MAX_SECONDARY_VEINS = 14
SECONDARY_STEPS = 16
MIDRIB_STEPS = 32
PETIOLE_STEPS = 12


def vein_edges(
    leaf: LeafParams[Scalar], turtle_noise: tf.Tensor, jitter: tf.Tensor, width_mm: tf.Tensor
) -> tf.Tensor:
    """Return the stroke edges of all veins, [n, 2 ends, 2] in leaf coordinates, mm, midrib first.

    `turtle_noise` [2, n, SECONDARY_STEPS + 2] is standard normal, `jitter` scales it, `width_mm` is the
    midrib's width at the base. The number of edges is fixed, since compiled functions have fixed shapes: a
    vein that the leaf lacks has no width.
    """
    along = tf.constant(np.linspace(-0.02, 0.96, MIDRIB_STEPS), tf.float32)
    middle, _ = midrib(leaf, along * leaf.length_mm)
    taper = tf.constant(np.linspace(1, 0.25, MIDRIB_STEPS), tf.float32)
    main = polygon_edges(stroke_outlines(middle, width_mm * taper))
    paths, exists = secondary_paths(leaf, turtle_noise, jitter)
    thinning = tf.constant(np.linspace(0.55, 0.12, SECONDARY_STEPS + 1), tf.float32)
    side = polygon_edges(stroke_outlines(paths, width_mm * exists[..., None] * thinning))
    return tf.concat([main, tf.reshape(side, [-1, 2, 2])], axis=0)


def petiole_edges(leaf: LeafParams[Scalar], is_drawn: tf.Tensor) -> tf.Tensor:
    """Return the edges [n, 2 ends, 2] of a stroke that covers the petiole, of no width unless `is_drawn` [].

    In leaf coordinates, mm.
    """
    share = tf.constant(np.linspace(-1.02, 0.02, PETIOLE_STEPS), tf.float32)
    middle, _ = midrib(leaf, share * leaf.petiole * leaf.length_mm)
    # The petiole is up to 1.5 times as wide at its end.
    width = tf.where(is_drawn, 1.6 * leaf.petiole_width_mm, 0.0)
    return polygon_edges(stroke_outlines(middle, tf.repeat(width, PETIOLE_STEPS)))


def secondary_paths(
    leaf: LeafParams[Scalar], turtle_noise: tf.Tensor, jitter: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the paths [2, n, SECONDARY_STEPS + 1, 2] mm of secondary veins, and 1 for each that exists.

    The others have 0. `turtle_noise` [2, n, SECONDARY_STEPS + 2] is standard normal.
    """
    rank = (tf.range(turtle_noise.shape[1], dtype=tf.float32) + 0.6) / leaf.veins
    along = rank * 0.93 + 0.012 * turtle_noise[..., 0]
    number = tf.floor(leaf.veins * 1.05 + 1)
    exists = tf.cast(
        (along < 0.95) & (tf.range(turtle_noise.shape[1], dtype=tf.float32) < number), tf.float32
    )
    start, tangent = midrib(leaf, along * leaf.length_mm)
    forward = tf.atan2(tangent[..., 1], tangent[..., 0])
    side = tf.constant([-1.0, 1.0])[:, None]
    angle = leaf.vein_angle * (1.15 - 0.4 * along) + 0.06 * turtle_noise[..., 1]
    length = leaf.length_mm * leaf.aspect * (0.75 - 0.45 * along * along)
    steps = tf.repeat((length / SECONDARY_STEPS)[..., None], SECONDARY_STEPS, axis=-1)
    turns = side[..., None] * (jitter * turtle_noise[..., 2:] - 0.035)
    return walk_turtles(start, forward + side * angle, turns, steps), exists


def walk_turtles(start: tf.Tensor, heading: tf.Tensor, turns: tf.Tensor, steps: tf.Tensor) -> tf.Tensor:
    """Walk turtles through their commands [..., n]; return their paths [..., n + 1, 2].

    Each command turns the turtle by `turns` [..., n] radians, then moves it `steps` [..., n] forward; it
    starts at `start` [..., 2] with the given `heading` [...]. Paths are in the unit of `steps`.
    """
    direction = heading[..., None] + tf.cumsum(turns, axis=-1)
    moves = steps[..., None] * tf.stack([tf.cos(direction), tf.sin(direction)], axis=-1)
    path = start[..., None, :] + tf.cumsum(moves, axis=-2)
    return tf.concat([start[..., None, :], path], axis=-2)
