"""Things of a leaf's colour that were not counted, on drawn sheets."""

import cv2
import numpy as np
import pytest

from laesi_tf.common.arrays import Points
from laesi_tf.estimators.mask_estimator import MaskEstimatorParams
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.uncounted_things import find_uncounted

GREEN, BROWN, YELLOW = (60, 110, 40), (120, 80, 40), (200, 170, 60)
PARAMS = MaskEstimatorParams()


def draw_sheet() -> np.ndarray:
    sheet = np.full((900, 1200, 3), 232, np.uint8)
    sheet[::8] = sheet[:, ::8] = (215, 190, 190)
    return sheet


def draw_leaf(
    sheet: np.ndarray, middle: tuple[int, int], axes: tuple[int, int], colour: tuple[int, int, int]
) -> Points:
    """Draw a leaf with a pointed tip; returns its outline."""
    turns = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    x = axes[0] * np.cos(turns)
    y = axes[1] * np.sin(turns) * np.cos(turns / 2) ** 2
    outline = np.stack([middle[0] + x, middle[1] + y], 1)
    cv2.fillPoly(sheet, [np.round(outline).astype(np.int32)], colour)
    return outline


def count(sheet: np.ndarray, leaves: list[Points], outline: Points | None = None) -> int:
    return find_uncounted(PhotoPyramid(sheet), leaves, [], outline, PARAMS).number


@pytest.mark.parametrize("colour", [GREEN, BROWN, YELLOW])
def test_a_leaf_that_is_not_counted_is_seen(colour: tuple[int, int, int]) -> None:
    sheet = draw_sheet()
    large = draw_leaf(sheet, (400, 400), (200, 160), GREEN)
    slim = draw_leaf(sheet, (900, 500), (140, 40), colour)
    assert count(sheet, [large]) == 1
    assert count(sheet, [large, slim]) == 0


def test_the_petiole_of_a_counted_leaf_belongs_to_it() -> None:
    sheet = draw_sheet()
    large = draw_leaf(sheet, (400, 400), (200, 160), GREEN)
    cv2.line(sheet, (600, 400), (760, 430), GREEN, 12)
    assert count(sheet, [large]) == 0


def test_shadows_and_made_things_are_no_leaves() -> None:
    sheet = draw_sheet()
    large = draw_leaf(sheet, (300, 400), (200, 160), GREEN)
    shadow = sheet[500:800, 700:1000]
    shadow[:] = (shadow * 0.5).astype(np.uint8)
    cv2.rectangle(sheet, (650, 80), (850, 220), YELLOW, -1)
    cv2.circle(sheet, (1050, 300), 60, BROWN, -1)
    cv2.putText(sheet, "Nr. 9", (100, 800), cv2.FONT_HERSHEY_SIMPLEX, 2, (20, 20, 120), 5)
    assert count(sheet, [large]) == 0


def test_only_the_sheet_is_searched() -> None:
    sheet = draw_sheet()
    large = draw_leaf(sheet, (300, 400), (200, 160), GREEN)
    draw_leaf(sheet, (1000, 500), (140, 60), GREEN)
    left_part = np.array([[0, 0], [700, 0], [700, 900], [0, 900]], float)
    assert count(sheet, [large]) == 1
    assert count(sheet, [large], left_part) == 0


def test_the_size_of_what_is_not_counted() -> None:
    sheet = draw_sheet()
    small = draw_leaf(sheet, (300, 400), (100, 80), GREEN)
    draw_leaf(sheet, (700, 450), (200, 160), GREEN)
    beside = draw_leaf(sheet, (1050, 450), (100, 300), GREEN)
    found = find_uncounted(PhotoPyramid(sheet), [small], [beside], None, PARAMS)
    assert found.number == 1
    assert found.relative_area == pytest.approx(4, rel=0.2)
