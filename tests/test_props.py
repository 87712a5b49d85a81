"""Things beside the leaf never cover it."""

import math

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, middle

from laesi_tf.synthesis import raster, sample
from laesi_tf.synthesis.editing import every_component
from laesi_tf.synthesis.keys import Key
from laesi_tf.synthesis.props import PROPS, Props, Stage, place, scatter, scribble
from laesi_tf.synthesis.scene import Scene, geometry, leaf_edges

SIZE = (160, 160)
RANGES = every_component(RENDERING_2.with_passes(1))
NOTHING = tf.fill([3, *SIZE], 2.0)
"""A picture brighter than anything, so that whatever lies on it is seen."""


def staged(index: int) -> tuple[Scene, Stage, np.ndarray]:
    """A scene, its stage, and where [H, W] its leaf is."""
    scene = sample(4, index, RANGES)
    around = geometry(scene, SIZE)
    cover = raster.fill(leaf_edges(around, SIZE), SIZE)
    return scene, Stage(leaf=around.outline, view=around.view, size=SIZE), np.abs(cover.numpy()) > 0.01


@pytest.mark.parametrize("name", PROPS)
def test_prop_is_seen_and_never_covers_the_leaf(name: str) -> None:
    covered = []
    for index in range(8):
        scene, stage, leaf = staged(index)
        laid = scatter(NOTHING, scene.props, stage, scene.key, [name]).numpy()
        touched = (np.abs(laid - 2) > 1e-4).any(axis=0)
        assert not (touched & leaf).any()
        assert np.isfinite(laid).all() and laid.min() >= -1e-4
        covered.append(touched.sum())
    assert max(covered) > 20


def test_nothing_named_lays_nothing() -> None:
    scene, stage, _ = staged(0)
    np.testing.assert_array_equal(scatter(NOTHING, scene.props, stage, scene.key, []), NOTHING)


@pytest.mark.parametrize("direction", np.linspace(-3, 3, 5).tolist())
def test_place_keeps_the_gap(direction: float) -> None:
    _, stage, _ = staged(1)
    square = tf.constant([[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]])
    points = place(square, stage, tf.constant(direction), tf.constant(0.4), tf.constant(3.0)).numpy()
    away = np.array([math.cos(direction), math.sin(direction)])
    assert (points @ away).min() - (stage.leaf.numpy() @ away).max() == pytest.approx(3, abs=1e-3)
    sides = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    np.testing.assert_allclose(sides, 10, atol=1e-4)


def test_writing_has_its_length_height_and_stroke() -> None:
    random = tf.constant(np.random.default_rng(0).uniform(size=32).astype(np.float32))
    word = scribble(random, tf.constant(30.0), tf.constant(3.0), middle(Props(), stroke_mm=0.5)).numpy()
    width, height = np.ptp(word, axis=0)
    assert 28 < width < 36 and 3 < height < 10
    half = len(word) // 2
    strokes = np.linalg.norm(word[:half] - word[half:][::-1], axis=1)
    np.testing.assert_allclose(strokes, 0.5, atol=1e-3)


def test_props_of_different_scenes_differ() -> None:
    scene, stage, _ = staged(2)
    one, other = (scatter(NOTHING, scene.props, stage, Key(0, i), ["fragment"]).numpy() for i in (0, 1))
    assert (one != other).any()
