"""Things beside the leaf never cover it."""

import dataclasses
import functools
import math
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, changed, complete, filled, middle

from laesi_tf.synthesis import load_ranges, sample_scene
from laesi_tf.synthesis.props.handwriting import HandwritingParams, handwriting_stroke
from laesi_tf.synthesis.props.placement import PropContext, place_beside_leaf
from laesi_tf.synthesis.props.registry import PROPS
from laesi_tf.synthesis.ranges import Probability
from laesi_tf.synthesis.renderer import compute_layout, draw_props
from laesi_tf.synthesis.scene import Scene
from laesi_tf.synthesis.scene_layout import SceneLayout, leaf_edges

SIZE = (160, 160)
RANGES = complete(changed(RENDERING_2, "props", **dict.fromkeys(PROPS, Probability(0.5))))
BRIGHT = tf.fill([3, *SIZE], 2.0)
"""An image brighter than any prop, on which every prop is visible."""


@functools.cache
def lay_out(index: int) -> tuple[Scene, SceneLayout, np.ndarray]:
    """Return a scene, its layout, and the pixels [H, W] of its leaf."""
    scene = sample_scene(4, index, RANGES)
    layout = compute_layout(scene, SIZE)
    coverage = filled(leaf_edges(layout, SIZE), SIZE)
    return scene, layout, np.abs(coverage.numpy()) > 0.01


def draw(name: str, scene: Scene, layout: SceneLayout) -> np.ndarray:
    """Return the image [3, H, W] of one prop."""
    return draw_props(
        BRIGHT, scene_of(scene, name), layout, SIZE, covers_leaf=PROPS[name].covers_leaf
    ).numpy()


@pytest.mark.parametrize("name", [name for name, prop in PROPS.items() if not prop.covers_leaf])
def test_prop_is_seen_and_never_covers_the_leaf(name: str) -> None:
    covered = []
    for index in range(8):
        scene, layout, leaf = lay_out(index)
        image = draw(name, scene, layout)
        is_changed = (np.abs(image - 2) > 1e-4).any(axis=0)
        assert not (is_changed & leaf).any()
        assert np.isfinite(image).all() and image.min() >= -1e-4
        covered.append(is_changed.sum())
    assert max(covered) > 20


@pytest.mark.parametrize("name", [name for name, prop in PROPS.items() if prop.covers_leaf])
def test_the_leaf_is_seen_through_what_covers_it(name: str) -> None:
    covered = []
    for index in range(4):
        scene, layout, leaf = lay_out(index)
        image = draw(name, scene, layout)
        assert np.isfinite(image).all()
        # Edges of glass are darker than the pane but thin.
        assert np.quantile(image[:, leaf], 0.1) > 2 - 0.35 * 2
        covered.append((np.abs(image[:, leaf] - 2) > 1e-4).mean())
        np.testing.assert_array_equal(draw_props(BRIGHT, scene_of(scene, name), layout, SIZE), BRIGHT)
    assert max(covered) > 0.02


def scene_of(scene: Scene, name: str) -> Scene:
    """Return the scene with prop `name` only."""
    return dataclasses.replace(scene, props={name: scene.props[name]})


def test_without_props_nothing_is_drawn() -> None:
    scene, layout, _ = lay_out(0)
    np.testing.assert_array_equal(
        draw_props(BRIGHT, dataclasses.replace(scene, props={}), layout, SIZE), BRIGHT
    )


@pytest.mark.parametrize("direction", np.linspace(-3, 3, 5).tolist())
def test_position_keeps_the_gap(direction: float) -> None:
    _, layout, _ = lay_out(1)
    context = PropContext(layout.outline, layout.view, tf.constant(SIZE[::-1], tf.float32))
    square = tf.constant([[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]])
    points = place_beside_leaf(
        square, context, tf.constant(direction), tf.constant(0.4), tf.constant(3.0)
    ).numpy()
    away = np.array([math.cos(direction), math.sin(direction)])
    assert (points @ away).min() - (context.outline.numpy() @ away).max() == pytest.approx(3, abs=1e-3)
    sides = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    np.testing.assert_allclose(sides, 10, atol=1e-4)


def test_writing_has_its_length_height_and_stroke() -> None:
    random = tf.constant(np.random.default_rng(0).uniform(size=32).astype(np.float32))
    word = handwriting_stroke(
        random, tf.constant(30.0), tf.constant(3.0), middle(HandwritingParams(), stroke_mm=0.5)
    ).numpy()
    width, height = np.ptp(word, axis=0)
    assert 28 < width < 36 and 3 < height < 10
    half = len(word) // 2
    strokes = np.linalg.norm(word[:half] - word[half:][::-1], axis=1)
    np.testing.assert_allclose(strokes, 0.5, atol=1e-3)


def test_props_of_different_scenes_differ() -> None:
    scene, layout, _ = lay_out(2)
    another, _, _ = lay_out(3)
    fragment = scene.props["fragment"]._replace(numbers=another.props["fragment"].numbers)
    other = dataclasses.replace(scene, props={"fragment": fragment})
    assert (draw("fragment", scene, layout) != draw("fragment", other, layout)).any()


CALIBRATION = load_ranges(Path(__file__).parents[1] / "experiments" / "calibration.toml")


def test_calibration_square_is_whole_and_has_its_size_on_the_sheet() -> None:
    """Measure it on the sheet, where the homography gives the size of each covered pixel."""
    for index in range(12):
        scene = sample_scene(8, index, CALIBRATION)
        layout = compute_layout(scene, SIZE)
        image = draw("calibration", scene, layout)
        covered = (2 - image[1]) / (2 - image[1].min())
        assert not covered[[0, -1]].any() and not covered[:, [0, -1]].any()
        rows, columns = np.nonzero(covered)
        to_px = layout.view.to_px.numpy().astype(np.float64)
        x, y, w = np.linalg.inv(to_px) @ np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
        depth = to_px[2] @ np.stack([x / w, y / w, np.ones_like(w)])
        found_mm2 = np.sum(covered[rows, columns] * np.abs(depth**3 / np.linalg.det(to_px)))
        assert found_mm2 == pytest.approx(400, rel=0.02)


@pytest.mark.parametrize("size", [(100, 150), (45, 45)])
def test_sizes_beyond_the_defaults_are_filled(size: tuple[float, float]) -> None:
    """A large card is filled like a small one: each of its rows from its first to its last pixel."""
    low, high = size
    ranges = changed(RANGES, "props", label_mm=size, label_aspect=0.7, gap_mm=2.0)
    ranges = changed(ranges, "camera", fill=0.2, tilted=Probability(0.0))
    for index in range(4):
        scene = sample_scene(6, index, ranges)
        layout = compute_layout(scene, SIZE)
        image = draw("label", scene, layout)
        assert np.isfinite(image).all() and image.min() >= -1e-4 and image.max() <= 2 + 1e-4
        # The card is convex: along each row all pixels between its first and its last are covered.
        covered = image.max(axis=0) < 1.5
        for row in covered:
            columns = np.nonzero(row)[0]
            assert len(columns) == 0 or np.ptp(columns) + 1 == len(columns)
        assert low <= float(scene.props["label"].params.label_mm) <= high
