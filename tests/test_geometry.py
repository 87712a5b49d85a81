"""Points, polygons and contours in one convention, and the homographies that tests compare with."""

import cv2
import numpy as np
import pytest
from homographies import apply_homography, compute_px_per_mm
from hypothesis import given
from hypothesis import strategies as st

from laesi_tf.common.geometry import (
    ImageSize,
    from_cv2_contour,
    polygon_area,
    polygon_centroid,
    polygon_main_axis,
    polygon_perimeter,
    to_cv2_points,
    trace_polygons,
)

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]])
TILTED = np.array([[0.19, 0.06, -60.0], [-0.06, 0.19, -20.0], [2e-4, -2.4e-4, 1.0]])


def test_image_size_is_height_and_width_and_its_corner_x_and_y() -> None:
    size = ImageSize.of(np.zeros((3, 5, 3)))
    assert size == (3, 5) and size.xy.tolist() == [5, 3]


def test_opencv_and_its_inverse_agree() -> None:
    mask = np.zeros((20, 30), np.uint8)
    mask[5:9, 10:17] = 1
    (contour,), _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = from_cv2_contour(contour)
    # The contour runs through the centres of the outermost pixels.
    assert points.min(axis=0).tolist() == [10.5, 5.5] and points.max(axis=0).tolist() == [16.5, 8.5]
    assert np.array_equal(to_cv2_points(points), contour[:, 0])
    assert np.array_equal(to_cv2_points(points, shift=4), contour[:, 0] * 16)


@given(st.floats(-3, 3), st.integers(0, 2))
def test_polygon_measures_do_not_depend_on_position_and_first_vertex(offset: float, start: int) -> None:
    polygon = np.roll(SQUARE, start, axis=0) + offset
    assert polygon_area(polygon) == pytest.approx(8) and polygon_area(polygon[::-1]) == pytest.approx(-8)
    assert polygon_perimeter(polygon) == pytest.approx(12)
    for direction in (polygon, polygon[::-1]):
        assert polygon_centroid(direction) == pytest.approx([2 + offset, 1 + offset])


def test_main_axis_does_not_depend_on_where_vertices_are() -> None:
    triangle = np.array([[0.0, 0.0], [10.0, 1.0], [10.0, -1.0]])
    dense = np.concatenate([np.linspace(triangle[0], triangle[1], 50), triangle[2:]])
    for polygon in (triangle, dense, dense[::-1]):
        assert abs(polygon_main_axis(polygon)) == pytest.approx([1, 0], abs=1e-6)


def test_scale_is_that_of_a_small_square() -> None:
    point = np.array([120.0, 340.0])
    pixel = point + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5
    area = abs(polygon_area(apply_homography(TILTED, pixel)))
    assert compute_px_per_mm(TILTED, point) == pytest.approx(area**-0.5, rel=1e-4)


def test_homography_and_its_inverse_agree() -> None:
    points = np.array([[0.0, 0.0], [300.0, 20.0], [70.0, 400.0]])
    back = apply_homography(np.linalg.inv(TILTED), apply_homography(TILTED, points))
    assert back == pytest.approx(points, abs=1e-8)


@pytest.mark.parametrize(("x", "y"), [(200.0, 150.0), (200.5, 150.25)])
def test_outline_of_a_disc_is_centred_on_it(x: float, y: float) -> None:
    rows, columns = np.mgrid[:300, :400] + 0.5
    (disc,) = trace_polygons(np.hypot(columns - x, rows - y) < 80)
    assert polygon_centroid(disc.outer) == pytest.approx([x, y], abs=0.05)
    assert abs(polygon_area(disc.outer)) == pytest.approx(np.pi * 80**2, rel=0.002)
    # Drawn through OpenCV it covers the same pixels.
    drawn = np.zeros((300, 400), np.uint8)
    cv2.fillPoly(drawn, [to_cv2_points(disc.outer, shift=4)], 1, shift=4)
    assert np.argwhere(drawn).mean(axis=0)[::-1] + 0.5 == pytest.approx([x, y], abs=0.1)


def test_a_component_at_the_border_keeps_its_area() -> None:
    mask = np.zeros((60, 80), bool)
    mask[:40, :50] = True
    (polygon,) = trace_polygons(mask)
    assert abs(polygon_area(polygon.outer)) == pytest.approx(2000, rel=0.003)
    assert polygon.outer.min() == pytest.approx(0, abs=0.2)


def test_components_are_sorted_by_area_and_keep_their_own_holes() -> None:
    mask = np.zeros((100, 100), bool)
    mask[70:90, 70:90] = mask[10:50, 10:60] = True
    mask[20:30, 20:30] = mask[75:85, 75:85] = False
    large, small = trace_polygons(mask)
    assert [len(large.holes), len(small.holes)] == [1, 1] and len(large.rings) == 2
    assert polygon_centroid(large.outer) == pytest.approx([35, 30], abs=0.2)
    assert polygon_centroid(small.holes[0]) == pytest.approx([80, 80], abs=0.2)


def test_a_line_one_pixel_wide_has_an_outline() -> None:
    mask = np.zeros((30, 30), bool)
    mask[15, 5:25] = True
    (line,) = trace_polygons(mask)
    assert np.isfinite(line.outer).all() and np.ptp(line.outer[:, 0]) > 15


def test_an_empty_mask_has_no_outline() -> None:
    assert trace_polygons(np.zeros((5, 7), bool)) == []
