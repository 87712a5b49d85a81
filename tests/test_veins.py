"""Turtles, strokes and the veins of a leaf."""

import math

import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import middle

from laesi_tf.synthesis.geometry import signed_area, stroke_outlines
from laesi_tf.synthesis.leaf import veins
from laesi_tf.synthesis.leaf.outline import midrib
from laesi_tf.synthesis.leaf.params import LeafParams
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.scene_numbers import sample_scene_numbers

COMMANDS = st.lists(st.tuples(st.floats(-3, 3), st.floats(0, 5)), min_size=1, max_size=12)
RANDOM = RandomStreams(0, 0).normal([2, 9, veins.SECONDARY_STEPS + 2], Stream.VEINS)


def walk(start: tuple[float, float], heading: float, commands: list[tuple[float, float]]) -> np.ndarray:
    """Walk the turtle of the paper, one command after the other."""
    path = [start]
    for turn, step in commands:
        heading += turn
        path.append((path[-1][0] + step * math.cos(heading), path[-1][1] + step * math.sin(heading)))
    return np.array(path)


@settings(max_examples=40, deadline=None)
@given(commands=COMMANDS, heading=st.floats(-4, 4), start=st.tuples(st.floats(-9, 9), st.floats(-9, 9)))
def test_turtle(commands: list[tuple[float, float]], heading: float, start: tuple[float, float]) -> None:
    turns, steps = (tf.constant(column, tf.float32) for column in zip(*commands, strict=True))
    path = veins.walk_turtles(tf.constant(start), tf.constant(heading), turns, steps)
    np.testing.assert_allclose(path, walk(start, heading, commands), atol=1e-3)


def test_stroke_of_a_straight_path_has_its_width() -> None:
    path = tf.constant(np.stack([np.linspace(0, 10, 6), np.linspace(0, 5, 6)], -1), tf.float32)
    outline = stroke_outlines(path, tf.fill([6], 1.5))
    assert abs(float(signed_area(outline))) == pytest.approx(math.hypot(10, 5) * 1.5, rel=1e-4)


def test_secondary_veins_leave_the_midrib_on_both_sides() -> None:
    leaf = middle(LeafParams(), veins=8.0)
    paths, exists = veins.secondary_paths(leaf, RANDOM, tf.constant(0.0))
    points, tangents = midrib(leaf, tf.linspace(0.0, 1.2, 2400) * leaf.length_mm)
    starts = tf.reshape(paths[:, :, 0], [-1, 2]).numpy()
    nearest = np.argmin(np.linalg.norm(starts[:, None] - points.numpy(), axis=-1), axis=1)
    assert np.linalg.norm(starts - points.numpy()[nearest], axis=-1).max() < 0.1
    first_steps = tf.reshape(paths[:, :, 1] - paths[:, :, 0], [-1, 2]).numpy()
    tangent = tangents.numpy()[nearest]
    side = tangent[:, 0] * first_steps[:, 1] - tangent[:, 1] * first_steps[:, 0]
    left, right = np.split(side, 2)
    assert (left < 0).all() and (right > 0).all()
    assert (np.sum(tangent * first_steps, axis=1) > 0).all()
    assert 7 <= float(tf.reduce_sum(exists[0])) <= 9


def test_brownian_jitter_makes_paths_wander() -> None:
    leaf = middle(LeafParams())
    straight, _ = veins.secondary_paths(leaf, RANDOM, tf.constant(0.0))
    jittery, _ = veins.secondary_paths(leaf, RANDOM, tf.constant(0.06))
    np.testing.assert_allclose(straight[:, :, 0], jittery[:, :, 0], atol=1e-4)
    headings = [np.arctan2(*np.moveaxis(np.diff(path, axis=2), -1, 0)) for path in (jittery, straight)]
    wander = np.diff(np.unwrap(headings[0] - headings[1]), axis=2)
    assert wander.std() == pytest.approx(0.06, rel=0.2) and abs(wander.mean()) < 0.01


def test_veins_taper_towards_their_ends() -> None:
    leaf = middle(LeafParams())
    edges = veins.vein_edges(
        leaf, sample_scene_numbers(RandomStreams(0, 0)).turtles, tf.constant(0.0), tf.constant(2.0)
    ).numpy()
    main = edges[: 2 * veins.MIDRIB_STEPS, 0]
    left, right = main[: veins.MIDRIB_STEPS], main[veins.MIDRIB_STEPS :][::-1]
    widths = np.linalg.norm(left - right, axis=1)
    assert widths[0] == pytest.approx(2, rel=0.02) and widths[-1] == pytest.approx(0.5, rel=0.05)
    assert (np.diff(widths) < 0).all()
