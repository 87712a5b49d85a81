"""Measures of a leaf against shapes whose measures are known, seen straight on and tilted."""

import math

import numpy as np
import pytest
from homographies import apply_homography
from hypothesis import given, settings
from hypothesis import strategies as st

from laesi_tf.common.geometry import Polygon, trace_polygons
from laesi_tf.estimators.leaf_shape import LeafShape, measure_polygon

SIDE = 500
TILTS = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15))


def make_homography(turn: float, tilt: tuple[float, float], scale: float) -> np.ndarray:
    """Homography [3, 3] from pixels of a SIDE x SIDE image to mm from its middle."""
    cosine, sine = math.cos(turn) / scale, math.sin(turn) / scale
    middle = np.array([[1, 0, -SIDE / 2], [0, 1, -SIDE / 2], [0, 0, 1]])
    return np.array([[cosine, sine, 0], [-sine, cosine, 0], [tilt[0] / SIDE, tilt[1] / SIDE, 1]]) @ middle


def sheet_coordinates(to_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sheet coordinates x and y in mm, [SIDE, SIDE] each, of the pixel centres."""
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    u, v, w = np.einsum("ij,jhw->ihw", to_mm, np.stack([columns, rows, np.ones_like(rows)]))
    return u / w, v / w


def measure(mask: np.ndarray, to_mm: np.ndarray) -> LeafShape:
    outer, *holes = (apply_homography(to_mm, ring) for ring in trace_polygons(mask)[0].rings)
    return measure_polygon(Polygon(outer, tuple(holes)))


@settings(max_examples=15, deadline=None)
@given(a=st.floats(24, 32), ratio=st.floats(0.3, 0.8), turn=st.floats(-math.pi, math.pi), tilt=TILTS)
def test_an_ellipse(a: float, ratio: float, turn: float, tilt: tuple[float, float]) -> None:
    to_mm, b = make_homography(turn, tilt, 6.0), a * ratio
    x, y = sheet_coordinates(to_mm)
    found = measure((x / a) ** 2 + (y / b) ** 2 < 1, to_mm)
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
    to_mm, b = make_homography(turn, tilt, 6.0), a * ratio
    x, y = sheet_coordinates(to_mm)
    found = measure((abs(x) < a / 2) & (abs(y) < b / 2), to_mm)
    assert found.area == pytest.approx(a * b, rel=0.004)
    assert (found.length, found.width) == pytest.approx((a, b), rel=0.015)
    assert found.perimeter == pytest.approx(2 * (a + b), rel=0.015)


@settings(max_examples=10, deadline=None)
@given(hole=st.floats(3, 15), turn=st.floats(-math.pi, math.pi), tilt=TILTS)
def test_a_disc_with_a_hole(hole: float, turn: float, tilt: tuple[float, float]) -> None:
    to_mm = make_homography(turn, tilt, 6.0)
    x, y = sheet_coordinates(to_mm)
    found = measure((np.hypot(x, y) < 30) & (np.hypot(x - 8, y) > hole), to_mm)
    assert found.holes == pytest.approx(math.pi * hole**2, rel=0.02)
    assert found.area == pytest.approx(math.pi * (30**2 - hole**2), rel=0.005)
    assert found.perimeter == pytest.approx(2 * math.pi * 30, rel=0.01)
