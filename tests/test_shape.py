"""A leaf's figures against shapes whose figures are known, seen straight on and tilted."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from laesi_tf.common.geometry import (
    apply_homography,
    compute_px_per_mm,
    main_axis,
    polygon_centroid,
    trace_polygons,
)
from laesi_tf.estimators.leaf_shape import measure_polygon

SIDE = 500
TILTS = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))


def view(turn: float, tilt: tuple[float, float], scale: float) -> np.ndarray:
    """Homography [3, 3] from pixels of a SIDE x SIDE picture to mm about its middle."""
    cosine, sine = math.cos(turn) / scale, math.sin(turn) / scale
    middle = np.array([[1, 0, -SIDE / 2], [0, 1, -SIDE / 2], [0, 0, 1]])
    return np.array([[cosine, sine, 0], [-sine, cosine, 0], [tilt[0] / SIDE, tilt[1] / SIDE, 1]]) @ middle


def sheet(to_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sheet mm [SIDE, SIDE] across and down at the pixels' middles."""
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    u, v, w = np.einsum("ij,jhw->ihw", to_mm, np.stack([columns, rows, np.ones_like(rows)]))
    return u / w, v / w


def figures(mask: np.ndarray, to_mm: np.ndarray):
    margin, holes = trace_polygons(mask)
    return measure_polygon(
        apply_homography(to_mm, margin), tuple(apply_homography(to_mm, hole) for hole in holes)
    )


@settings(max_examples=15, deadline=None)
@given(a=st.floats(24, 32), ratio=st.floats(0.3, 0.8), turn=st.floats(-math.pi, math.pi), tilt=TILTS)
def test_an_ellipse(a: float, ratio: float, turn: float, tilt: tuple[float, float]) -> None:
    to_mm, b = view(turn, tilt, 6.0), a * ratio
    x, y = sheet(to_mm)
    found = figures((x / a) ** 2 + (y / b) ** 2 < 1, to_mm)
    h = ((a - b) / (a + b)) ** 2
    ramanujan = math.pi * (a + b) * (1 + 3 * h / (10 + math.sqrt(4 - 3 * h)))
    assert found.area == pytest.approx(math.pi * a * b, rel=0.004) and found.holes == 0
    # A mask's pixels leave half a pixel open on each side; one is a sixth of a millimetre.
    assert (found.length, found.width) == pytest.approx((2 * a, 2 * b), abs=1 / 6)
    assert found.perimeter == pytest.approx(ramanujan, rel=0.01)


@settings(max_examples=15, deadline=None)
@given(a=st.floats(40, 55), ratio=st.floats(0.3, 0.8), turn=st.floats(0.1, 1.4), tilt=TILTS)
def test_a_rectangle(a: float, ratio: float, turn: float, tilt: tuple[float, float]) -> None:
    # Turned, since the mask of one along the pixels is wrong by up to half a pixel on each side.
    to_mm, b = view(turn, tilt, 6.0), a * ratio
    x, y = sheet(to_mm)
    found = figures((abs(x) < a / 2) & (abs(y) < b / 2), to_mm)
    assert found.area == pytest.approx(a * b, rel=0.004)
    assert (found.length, found.width) == pytest.approx((a, b), rel=0.015)
    assert found.perimeter == pytest.approx(2 * (a + b), rel=0.015)


@settings(max_examples=10, deadline=None)
@given(hole=st.floats(3, 15), turn=st.floats(-math.pi, math.pi), tilt=TILTS)
def test_a_disc_with_a_hole(hole: float, turn: float, tilt: tuple[float, float]) -> None:
    to_mm = view(turn, tilt, 6.0)
    x, y = sheet(to_mm)
    found = figures((np.hypot(x, y) < 30) & (np.hypot(x - 8, y) > hole), to_mm)
    assert found.holes == pytest.approx(math.pi * hole**2, rel=0.02)
    assert found.area == pytest.approx(math.pi * (30**2 - hole**2), rel=0.005)
    assert found.perimeter == pytest.approx(2 * math.pi * 30, rel=0.01)


def test_a_leaf_that_touches_the_border_keeps_its_area() -> None:
    mask = np.zeros((60, 80), bool)
    mask[:40, :50] = True
    margin, holes = trace_polygons(mask)
    assert measure_polygon(margin, holes).area == pytest.approx(2000, rel=0.003)
    assert margin.min() == pytest.approx(0, abs=0.2)


def test_only_the_largest_piece_and_its_own_holes_count() -> None:
    mask = np.zeros((100, 100), bool)
    mask[10:50, 10:60] = mask[70:90, 70:90] = True
    mask[20:30, 20:30] = mask[75:85, 75:85] = False
    margin, holes = trace_polygons(mask)
    assert len(holes) == 1 and measure_polygon(margin, holes).area == pytest.approx(1900, rel=0.01)
    assert polygon_centroid(margin) == pytest.approx([35, 30], abs=0.2)


def test_a_line_one_pixel_wide_has_an_outline() -> None:
    mask = np.zeros((30, 30), bool)
    mask[15, 5:25] = True
    margin, _ = trace_polygons(mask)
    assert np.isfinite(margin).all() and np.ptp(margin[:, 0]) > 15


def test_main_axis_does_not_depend_on_where_vertices_lie() -> None:
    triangle = np.array([[0.0, 0.0], [10.0, 1.0], [10.0, -1.0]])
    dense = np.concatenate([np.linspace(triangle[0], triangle[1], 50), triangle[2:]])
    for polygon in (triangle, dense, dense[::-1]):
        assert abs(main_axis(polygon)) == pytest.approx([1, 0], abs=1e-6)


def test_scale_is_that_of_small_squares() -> None:
    to_mm, point = view(0.3, (0.1, -0.12), 5.0), np.array([120.0, 340.0])
    square = point + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5
    assert compute_px_per_mm(to_mm, point) == pytest.approx(
        measure_polygon(apply_homography(to_mm, square), ()).area ** -0.5, rel=1e-4
    )
