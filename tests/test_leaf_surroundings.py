"""Whether something other than paper touches a leaf, on drawn sheets."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from laesi_tf.estimators.leaf_surroundings import SurroundingsParams, is_touched

SIZE = 300
PARAMS = SurroundingsParams()
LEAF_GREEN = (70, 120, 50)


def draw_sheet(light: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> np.ndarray:
    """A ruled sheet, float32, in light of this colour."""
    sheet = np.full((SIZE, SIZE, 3), 230, np.float32)
    sheet[::6] = sheet[:, ::6] = (200, 160, 160)
    return sheet * np.float32(light)


def draw_leaf(sheet: np.ndarray) -> np.ndarray:
    """Paint an ellipse green; returns its mask."""
    mask = np.zeros((SIZE, SIZE), np.uint8)
    cv2.ellipse(mask, (150, 150), (90, 50), 20, 0, 360, 1, -1)
    sheet[mask > 0] = LEAF_GREEN
    return mask > 0


def check(image: np.ndarray, leaf: np.ndarray, others: np.ndarray | None = None) -> bool:
    others = np.zeros_like(leaf) if others is None else others
    return is_touched(np.clip(image, 0, 255).astype(np.uint8), leaf, others, 2.0, PARAMS)


@given(
    level=st.floats(0.35, 1.0),
    warmth=st.floats(-0.15, 0.15),
    slope=st.floats(-0.4, 0.4),
)
def test_paper_in_any_light_is_paper(level: float, warmth: float, slope: float) -> None:
    sheet = draw_sheet((level * (1 + warmth), level, level * (1 - warmth)))
    sheet *= (1 + slope * np.linspace(-1, 1, SIZE, dtype=np.float32))[:, None, None]
    assert not check(sheet, draw_leaf(sheet))


def test_the_shadow_of_the_leaf_is_paper() -> None:
    sheet = draw_sheet()
    leaf = draw_leaf(sheet.copy())
    shadow = cv2.GaussianBlur(np.roll(leaf.astype(np.float32), (6, 6), (0, 1)), (0, 0), 3)
    sheet *= 1 - 0.6 * shadow[..., None]
    sheet[leaf] = LEAF_GREEN
    assert not check(sheet, leaf)


@pytest.mark.parametrize("colour", [(225, 170, 140), (240, 220, 90), (40, 60, 150), (8, 8, 8)])
def test_what_covers_a_part_of_the_leaf_touches_it(colour: tuple[int, int, int]) -> None:
    sheet = draw_sheet()
    leaf = draw_leaf(sheet)
    cover = np.zeros_like(leaf)
    cover[:, 180:240] = True
    sheet[cover] = colour
    assert check(sheet, leaf & ~cover)


def test_a_pale_margin_that_is_left_out_touches_the_rest() -> None:
    sheet = draw_sheet()
    leaf = draw_leaf(sheet)
    inner = cv2.erode(leaf.astype(np.uint8), np.ones((17, 17), np.uint8)) > 0
    sheet[leaf & ~inner] = (235, 225, 160)
    assert check(sheet, inner)
    assert not check(sheet, leaf)


def test_another_leaf_beside_it_is_no_cover() -> None:
    sheet = draw_sheet()
    leaf = draw_leaf(sheet)
    other = np.zeros_like(leaf)
    other[:, :70] = True
    sheet[other] = LEAF_GREEN
    assert check(sheet, leaf & ~other)
    assert not check(sheet, leaf & ~other, others=other)


def test_without_enough_pixels_nothing_is_said() -> None:
    sheet = draw_sheet()
    assert not check(sheet, np.ones((SIZE, SIZE), bool))
