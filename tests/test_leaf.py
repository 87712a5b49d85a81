"""Outlines, holes and the label's area against analytic shapes."""

import itertools
import math

import cv2
import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import middle

from laesi_tf.synthesis.geometry import find_segments, interpolate_at, signed_area
from laesi_tf.synthesis.leaf.holes import HOLE_POINTS, HOLES, hole_outlines
from laesi_tf.synthesis.leaf.mesh import leaf_area_cm2
from laesi_tf.synthesis.leaf.outline import (
    OUTLINE_POINTS,
    half_width,
    midrib,
    trace_outline,
)
from laesi_tf.synthesis.leaf.params import LEAF_KINDS, LeafParams
from laesi_tf.synthesis.random_streams import RandomStreams
from laesi_tf.synthesis.ranges import field_count, sample_params
from laesi_tf.synthesis.scene_numbers import sample_scene_numbers

NO_HOLES = np.zeros((HOLES, HOLE_POINTS, 2), np.float32)


def sides(width: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Outline [2n, 2] whose left and right side are `width` [n] apart at `along` [n]."""
    left, right = np.stack([along, -width / 2], -1), np.stack([along, width / 2], -1)
    return np.concatenate([left, right[::-1]]).astype(np.float32)


def circle(radius: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, HOLE_POINTS, endpoint=False)
    grown = radius / math.sqrt(math.sin(2 * math.pi / HOLE_POINTS) * HOLE_POINTS / (2 * math.pi))
    return (np.stack([np.cos(angle), -np.sin(angle)], -1) * grown).astype(np.float32)


def sample_leaf(kind: str, index: int) -> LeafParams:
    ranges = LEAF_KINDS[kind][1]
    uniform = np.random.default_rng(index).uniform(size=field_count(ranges)).astype(np.float32)
    return sample_params(ranges, tf.constant(uniform))


def outline_of(leaf: LeafParams, streams: RandomStreams) -> tf.Tensor:
    points, lengths = trace_outline(leaf, sample_scene_numbers(streams).outline)
    return interpolate_at(points, lengths, find_segments(lengths, OUTLINE_POINTS))


def holes_of(leaf: LeafParams, streams: RandomStreams) -> tf.Tensor:
    return hole_outlines(leaf, sample_scene_numbers(streams).holes)


@settings(max_examples=20, deadline=None)
@given(a=st.floats(1, 80), b=st.floats(1, 80))
def test_ellipse(a: float, b: float) -> None:
    along = -a * np.cos(np.linspace(0, np.pi, 1025))
    outline = sides(2 * b * np.sqrt(np.clip(1 - (along / a) ** 2, 0, None)), along)
    assert float(leaf_area_cm2(outline, NO_HOLES)) == pytest.approx(math.pi * a * b / 100, rel=1e-5)


def test_rectangle() -> None:
    outline = sides(np.full(9, 30.0), np.linspace(0, 70, 9))
    assert float(leaf_area_cm2(outline, NO_HOLES)) == pytest.approx(21, rel=1e-6)


def test_disk_with_a_hole() -> None:
    along = -40 * np.cos(np.linspace(0, np.pi, 2049))
    outline = sides(2 * np.sqrt(np.clip(40**2 - along**2, 0, None)), along)
    holes = NO_HOLES.copy()
    holes[1] = circle(10)
    assert float(leaf_area_cm2(outline, holes)) == pytest.approx(math.pi * 15, rel=1e-5)


def test_half_width_is_one_where_the_leaf_is_widest_and_zero_at_its_ends() -> None:
    leaf = middle(LeafParams(), widest=0.4)
    profile = half_width(leaf, tf.constant([0.0, 0.2, 0.4, 0.7, 1.0])).numpy()
    base, tip = (float(power) for power in (leaf.base_power, leaf.tip_power))
    expected = [0, (1 - 0.25) ** base, 1, (1 - 0.25) ** tip, 0]
    np.testing.assert_allclose(profile, expected, atol=2e-3)


@pytest.mark.parametrize("kind", LEAF_KINDS)
def test_outlines_of_every_kind(kind: str) -> None:
    for index in range(3):
        outline = outline_of(sample_leaf(kind, index), RandomStreams(0, index)).numpy()
        assert outline.shape == (OUTLINE_POINTS, 2) and np.isfinite(outline).all()
        gaps = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
        # Even along the curve, so a chord is at most its arc and shorter where the curve turns.
        assert gaps.max() < 1.01 * np.median(gaps) and gaps.min() > 0
        shoelace = abs(float(signed_area(outline))) / 100
        assert float(leaf_area_cm2(outline, NO_HOLES)) == pytest.approx(shoelace, rel=1e-4)


@pytest.mark.parametrize("kind", LEAF_KINDS)
def test_holes_lie_within_the_leaf_and_apart(kind: str) -> None:
    for index in range(4):
        leaf = middle(LEAF_KINDS[kind][1], holed=True, bitten=True)
        outline, holes = outline_of(leaf, RandomStreams(1, index)), holes_of(leaf, RandomStreams(1, index))
        areas = signed_area(holes).numpy()
        present = [hole for hole, area in zip(holes.numpy(), areas, strict=True) if abs(area) > 0]
        contour = outline.numpy()[:, None]
        for hole in present:
            assert min(cv2.pointPolygonTest(contour, point.tolist(), False) for point in hole) > 0
        for one, other in itertools.pairwise(present):
            assert np.linalg.norm(one[:, None] - other[None], axis=-1).min() > 0.1
        assert (areas * float(signed_area(outline)) <= 0).all()


def test_holes_come_and_go_with_the_number() -> None:
    whole = middle(LeafParams(), holed=False)
    assert not signed_area(holes_of(whole, RandomStreams(0, 0))).numpy().any()
    holed = middle(LeafParams(), holed=True)
    assert any(signed_area(holes_of(holed, RandomStreams(0, index))).numpy().any() for index in range(4))


def test_bites_take_area_and_leave_the_rest() -> None:
    bitten, spared = (
        [outline_of(middle(LeafParams(), bitten=b), RandomStreams(0, index)) for index in range(6)]
        for b in (True, False)
    )
    lost = [float(abs(signed_area(s)) - abs(signed_area(b))) for s, b in zip(spared, bitten, strict=True)]
    assert min(lost) >= -1 and max(lost) > 20


@settings(max_examples=10, deadline=None)
@given(bend=st.floats(-0.45, 0.45), change=st.floats(-0.5, 0.5), petiole=st.floats(-1.2, 1.2))
def test_midrib_is_the_integral_of_its_heading(bend: float, change: float, petiole: float) -> None:
    leaf = middle(LeafParams(), length_mm=100.0, bend=bend, bend_change=change, petiole_bend=petiole)
    for end in (100.0, 60.0, -35.0):
        t = np.linspace(0, end / 100, 2001)
        heading = petiole * t if end < 0 else bend * t + bend * change * t * t
        steps = np.stack([np.cos(heading), np.sin(heading)], -1)
        expected = np.sum((steps[1:] + steps[:-1]) / 2, axis=0) * (end / 2000)
        point, tangent = midrib(leaf, tf.constant(end))
        np.testing.assert_allclose(point, expected, atol=1.5)
        np.testing.assert_allclose(tangent, steps[-1], atol=1e-4)


def test_numbers_shape_the_leaf() -> None:
    def box(**given: float) -> np.ndarray:
        plain = {"angle": 0.0, "bend": 0.0, "petiole": 0.0, "cordate": 0.0, "length_mm": 80.0} | given
        return np.ptp(outline_of(middle(LeafParams(), **plain), RandomStreams(0, 0)).numpy(), axis=0)

    assert box()[0] == pytest.approx(80, rel=0.02)
    assert box(length_mm=120.0)[0] == pytest.approx(120, rel=0.02)
    assert box(aspect=0.7)[1] == pytest.approx(0.7 * 80, rel=0.1)
    assert box(petiole=0.25)[0] == pytest.approx(100, rel=0.02)
    assert box(bend=0.45)[0] < box()[0]


def test_left_and_right_differ() -> None:
    outline = outline_of(middle(LeafParams(), bend=0.0, bitten=False), RandomStreams(0, 0)).numpy()
    half = OUTLINE_POINTS // 2
    left, right = outline[:half], outline[half:][::-1]
    assert 0.05 < np.abs(left[:, 1] + right[:, 1]).max() < 5
