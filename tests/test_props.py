"""Things beside the leaf never cover it."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from scenes import complete, filled, middle

from laesi_tf.synthesis import load_ranges, sample_scene
from laesi_tf.synthesis.props.handwriting import handwriting_stroke
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.placement import PropContext, place_beside_leaf
from laesi_tf.synthesis.props.registry import PROPS
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Probability, _low_bits, field_count, sample_params
from laesi_tf.synthesis.renderer import compute_layout, draw_props
from laesi_tf.synthesis.scene import Scene
from laesi_tf.synthesis.scene_layout import SceneLayout, leaf_edges

SIZE = (160, 160)
RANGES = complete()
BRIGHT = tf.fill([3, *SIZE], 2.0)
"""An image brighter than any prop, on which every prop is visible."""


def lay_out(index: int) -> tuple[Scene, SceneLayout, np.ndarray]:
    """Return a scene, its layout, and the pixels [H, W] of its leaf."""
    scene = sample_scene(4, index, RANGES)
    layout = compute_layout(scene, SIZE)
    coverage = filled(leaf_edges(layout, SIZE), SIZE)
    return scene, layout, np.abs(coverage.numpy()) > 0.01


def draw(name: str, scene: Scene, layout: SceneLayout) -> np.ndarray:
    """Return the image [3, H, W] of one prop."""
    return draw_props(BRIGHT, scene, layout, SIZE, (name,)).numpy()


@pytest.mark.parametrize("name", PROPS)
def test_prop_is_seen_and_never_covers_the_leaf(name: str) -> None:
    covered = []
    for index in range(8):
        scene, layout, leaf = lay_out(index)
        image = draw(name, scene, layout)
        changed = (np.abs(image - 2) > 1e-4).any(axis=0)
        assert not (changed & leaf).any()
        assert np.isfinite(image).all() and image.min() >= -1e-4
        covered.append(changed.sum())
    assert max(covered) > 20


def test_without_props_nothing_is_drawn() -> None:
    scene, layout, _ = lay_out(0)
    np.testing.assert_array_equal(draw_props(BRIGHT, scene, layout, SIZE, ()), BRIGHT)


@pytest.mark.parametrize("direction", np.linspace(-3, 3, 5).tolist())
def test_position_keeps_the_gap(direction: float) -> None:
    _, layout, _ = lay_out(1)
    context = PropContext(layout.outline, layout.view.to_px, tf.constant(SIZE[::-1], tf.float32))
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
        random, tf.constant(30.0), tf.constant(3.0), middle(PropsParams(), stroke_mm=0.5)
    ).numpy()
    width, height = np.ptp(word, axis=0)
    assert 28 < width < 36 and 3 < height < 10
    half = len(word) // 2
    strokes = np.linalg.norm(word[:half] - word[half:][::-1], axis=1)
    np.testing.assert_allclose(strokes, 0.5, atol=1e-3)


def test_props_of_different_scenes_differ() -> None:
    scene, layout, _ = lay_out(2)
    one, other = (
        draw("fragment", dataclasses.replace(scene, streams=RandomStreams(0, index)), layout)
        for index in (0, 1)
    )
    assert (one != other).any()


CALIBRATION = load_ranges(Path(__file__).parents[1] / "experiments" / "calibration.toml")


def test_calibration_square_is_whole_and_has_its_size_on_the_sheet() -> None:
    """Counted on the sheet: each pixel that it covers has the size that the homography gives it there."""
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


def test_the_square_moves_no_number_of_pictures_without_it() -> None:
    """Its fields take no uniform number of their own, and its row of random numbers is the last."""
    without_late = [field.name for field in dataclasses.fields(PropsParams) if "late" not in field.metadata]
    uniform = tf.constant(
        np.random.default_rng(0).uniform(size=field_count(PropsParams())).astype(np.float32)
    )
    assert len(uniform) == len(without_late) and list(PROPS)[-1] == "calibration"
    drawn = sample_params(PropsParams(), uniform)
    for name, number in zip(without_late, uniform.numpy(), strict=True):
        spec = getattr(PropsParams(), name)
        low, high = (spec.p - 1, spec.p) if isinstance(spec, Probability) else spec
        value = np.float32(low) + number * (np.float32(high) - np.float32(low))
        assert getattr(drawn, name).numpy() == (value >= 0 if isinstance(spec, Probability) else value), name
    before, now = (RandomStreams(3, 7).uniform([rows, 80], Stream.PROPS).numpy() for rows in (5, 6))
    np.testing.assert_array_equal(before, now[:5])


def test_late_numbers_are_uniform_and_independent_of_those_they_are_made_from() -> None:
    uniform = RandomStreams(0, 0).uniform([4000], Stream.SCENE)
    low = _low_bits(uniform).numpy()
    assert low.min() >= 0 and low.max() < 1
    assert low.mean() == pytest.approx(0.5, abs=0.02) and low.var() == pytest.approx(1 / 12, rel=0.05)
    assert abs(np.corrcoef(uniform.numpy(), low)[0, 1]) < 0.05
