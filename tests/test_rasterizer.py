"""Coverage of polygons against analytic areas and a supersampled reference."""

import math

import numpy as np
import pytest
import scenes
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.draw import polygon2mask

from laesi_tf.synthesis import rasterizer
from laesi_tf.synthesis.geometry import polygon_edges, resample_polygon, signed_area, subdivide_polygon

FAST = settings(max_examples=25, deadline=None)
OFFSETS = st.floats(0, 1)


def ellipse(centre: tuple[float, float], radii: tuple[float, float], *, count: int = 720) -> np.ndarray:
    """Points [count, 2], clockwise on screen, whose polygon has the ellipse's area."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    # A polygon through points of the ellipse lacks slivers; their share is known exactly.
    grown = 1 / math.sqrt(math.sin(2 * math.pi / count) * count / (2 * math.pi))
    circle = np.stack([np.cos(angle), np.sin(angle)], -1)
    return (np.array(centre) + circle * radii * grown).astype(np.float32)


def rectangle(left: float, top: float, width: float, height: float) -> np.ndarray:
    corners = [[left, top], [left + width, top], [left + width, top + height], [left, top + height]]
    return np.array(corners, np.float32)


def filled(*polygons: np.ndarray, size: tuple[int, int] = (96, 128), pieces: int = 128) -> np.ndarray:
    edges = [
        tf.reshape(polygon_edges(subdivide_polygon(tf.constant(points), pieces)), [-1, 2, 2])
        for points in polygons
    ]
    return scenes.filled(tf.concat(edges, axis=0), size).numpy()


@FAST
@given(dx=OFFSETS, dy=OFFSETS, a=st.floats(0.4, 40), b=st.floats(0.4, 40))
def test_ellipse(dx: float, dy: float, a: float, b: float) -> None:
    # Its edges are short as they are; cut further, those of a tiny ellipse drown in float32's rounding.
    cover = np.abs(filled(ellipse((60 + dx, 46 + dy), (a, b)), pieces=1))
    assert cover.sum() == pytest.approx(math.pi * a * b, rel=1e-4, abs=1e-3)


@FAST
@given(left=st.floats(1, 60), top=st.floats(1, 40), width=st.floats(0.1, 60), height=st.floats(0.1, 50))
def test_rectangle_pixel_by_pixel(left: float, top: float, width: float, height: float) -> None:
    rows, columns = (
        np.clip(np.minimum(start + extent, np.arange(n) + 1) - np.maximum(start, np.arange(n)), 0, None)
        for start, extent, n in ((top, height, 96), (left, width, 128))
    )
    expected = np.clip(rows, 0, 1)[:, None] * np.clip(columns, 0, 1)
    np.testing.assert_allclose(np.abs(filled(rectangle(left, top, width, height))), expected, atol=2e-4)


def test_disk_with_a_hole() -> None:
    disk, hole = ellipse((64.3, 48.6), (40, 40)), ellipse((70.1, 50.2), (12, 12))[::-1]
    found = np.abs(filled(disk, hole))
    assert found.sum() == pytest.approx(math.pi * (40**2 - 12**2), rel=1e-5)
    assert found[50, 70] == pytest.approx(0, abs=1e-4) and found[48, 40] == pytest.approx(1, abs=1e-4)


@FAST
@given(seed=st.integers(0, 10**6), spikes=st.integers(3, 12))
def test_pixels_of_any_star_against_supersampling(seed: int, spikes: int) -> None:
    random = np.random.default_rng(seed)
    # Less than half a turn from spike to spike, or sides might cross.
    angle = (np.arange(spikes) + random.uniform(0, 0.4, spikes)) * 2 * np.pi / spikes
    reach = random.uniform(4, 22, spikes)
    star = np.stack([24 + reach * np.cos(angle), 24 + reach * np.sin(angle)], -1).astype(np.float32)
    fine = polygon2mask((48 * 16, 48 * 16), star[:, ::-1] * 16 - 0.5)
    expected = fine.reshape(48, 16, 48, 16).mean(axis=(1, 3))
    # Sides of at most 44 pixels: edges nearly as long as they may be.
    found = np.abs(filled(star, size=(48, 48), pieces=23))
    np.testing.assert_allclose(found, expected, atol=0.13)
    assert np.abs(found - expected).mean() < 2e-3


@FAST
@given(x=st.floats(-60, 180), y=st.floats(-60, 140))
def test_parts_outside_of_the_image_are_clipped(x: float, y: float) -> None:
    points = ellipse((x, y), (30, 22), count=90)
    everything = filled(points + np.float32(100), size=(320, 360))
    # What crosses the right border is moved a thousandth of a pixel inwards.
    np.testing.assert_allclose(filled(points), everything[100:196, 100:228], atol=2e-3)


def test_union_of_overlapping_shapes_covers_once() -> None:
    two = np.stack([ellipse((50, 48), (20, 20)), ellipse((62, 48), (20, 20))])
    cover = rasterizer.union_coverage(
        scenes.filled(tf.reshape(polygon_edges(two), [-1, 2, 2]), (96, 128))
    ).numpy()
    lens = 2 * 20**2 * math.acos(12 / 40) - 6 * math.sqrt(4 * 20**2 - 12**2)
    assert cover.max() <= 1 and cover.sum() == pytest.approx(2 * math.pi * 400 - lens, rel=2e-3)


def test_union_is_bounded_where_loops_overlap() -> None:
    cover = rasterizer.union_coverage(tf.constant([[-2.0, -0.4, 0.0, 3.0]]))
    np.testing.assert_allclose(cover, [[1, 0.4, 0, 1]])


def test_area_has_the_sign_of_the_turn() -> None:
    points = rectangle(2, 3, 7, 5)
    assert float(signed_area(tf.constant(points))) == 35 and float(signed_area(points[::-1])) == -35


@FAST
@given(pieces=st.integers(1, 9))
def test_subdividing_keeps_corners_and_area(pieces: int) -> None:
    points = ellipse((30, 40), (10, 17), count=11)
    fine = subdivide_polygon(tf.constant(points), pieces).numpy()
    assert fine.shape == (11 * pieces, 2)
    np.testing.assert_allclose(fine[::pieces], points)
    assert float(signed_area(fine)) == pytest.approx(float(signed_area(points)), rel=1e-5)


def test_resampling_is_even_and_stays_on_the_outline() -> None:
    points = rectangle(0, 0, 30, 10)
    even = resample_polygon(tf.constant(points), 160).numpy()
    gaps = np.linalg.norm(np.roll(even, -1, axis=0) - even, axis=1)
    np.testing.assert_allclose(gaps, 0.5, atol=1e-4)
    on_side = np.isclose(even[:, 0] % 30, 0, atol=1e-4) | np.isclose(even[:, 1] % 10, 0, atol=1e-4)
    assert on_side.all()
