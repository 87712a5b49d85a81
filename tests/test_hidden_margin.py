"""Margins of leaves that have the colour of paper, on drawn sheets."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from laesi_tf.common.geometry import trace_polygons
from laesi_tf.estimators.hidden_margin import HiddenMarginParams, add_hidden_margin
from laesi_tf.estimators.leaf_outline import HIDDEN_MARGIN, LeafOutline
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.print_visibility import PrintVisibilityParams, measure_visibility
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera

SIDE, PAPER, GREEN = 600, (236, 230, 224), (60, 110, 50)
CORNERS = np.array([[0.0, 0], [SIDE, 0], [SIDE, SIDE], [0, SIDE]])
LEAF, MARGIN = ((300, 300), (150, 80)), ((300, 300), (180, 110))
"""Middle and half axes of the green part, and of the leaf with its margin."""


def make_camera(line_px: float, turn: float) -> SheetCamera:
    parameters = np.zeros(14)
    c, s = np.array([np.cos(turn), np.sin(turn)]) * SIDE / 2 / line_px
    parameters[:6] = [0.3, -0.4, c, s, -s, c]
    return SheetCamera(parameters, np.zeros((14, 14)), (SIDE, SIDE))


MILLIMETRES = {1: 0.5, 5: 0.8, 10: 1.0}


def draw_sheet(
    camera: SheetCamera, *, strength: float = 0.3, levels: dict[int, float] = MILLIMETRES
) -> np.ndarray:
    """Paper with lines at multiples of each of `levels`, with its weight: float32 [SIDE, SIDE, 3]."""
    places = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    lines = camera.to_sheet(np.stack(places, -1))
    ink = np.zeros((SIDE, SIDE))
    for pitch, weight in levels.items():
        distance = np.abs(lines - pitch * np.round(lines / pitch)).min(axis=2)
        ink = np.maximum(ink, weight * np.exp(-((distance / 0.12) ** 2)))
    return (PAPER - strength * ink[..., None] * np.array([40.0, 200, 200])).astype(np.float32)


def paint(
    image: np.ndarray, ellipse: tuple[tuple[int, int], tuple[int, int]], colour: tuple[int, ...]
) -> None:
    cv2.ellipse(image, ellipse[0], ellipse[1], 25, 0, 360, colour, -1, cv2.LINE_AA)


def add_noise(image: np.ndarray) -> np.ndarray:
    noisy = image + np.random.default_rng(0).normal(0, 3, image.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def fill_ellipse(middle: tuple[int, int], axes: tuple[int, int]) -> np.ndarray:
    mask = np.zeros((SIDE, SIDE), np.uint8)
    return cv2.ellipse(mask, middle, axes, 25, 0, 360, 1, -1) > 0


GREEN_PART = fill_ellipse(*LEAF)


def outline_mask(photo: PhotoPyramid, mask: np.ndarray) -> LeafOutline:
    """The outline of the green part, as a network that does not know margins gives it."""
    return LeafOutline(
        crop=photo.photo,
        mask=mask,
        polygon=trace_polygons(mask)[0],
        area_sd_px=10.0,
        edge_sd_mm=0.02,
        is_cut_off=False,
        is_touched=False,
    )


def find_margin(
    image: np.ndarray, camera: SheetCamera, mask: np.ndarray = GREEN_PART, others: Sequence[np.ndarray] = ()
) -> LeafOutline:
    photo = PhotoPyramid(add_noise(image))
    return add_hidden_margin(outline_mask(photo, mask), others, CORNERS, camera, photo, HiddenMarginParams())


@settings(max_examples=5, deadline=None)
@given(line_px=st.floats(4.0, 9.0), turn=st.floats(0.0, 1.5), brightness=st.integers(-25, 8))
def test_a_margin_of_the_papers_colour_is_measured(line_px: float, turn: float, brightness: int) -> None:
    camera = make_camera(line_px, turn)
    image = draw_sheet(camera)
    paint(image, MARGIN, tuple(level + brightness for level in PAPER))
    paint(image, LEAF, GREEN)
    found = find_margin(image, camera)
    true_area = np.pi * np.prod(MARGIN[1])
    assert found.area_px == pytest.approx(true_area, rel=0.08)
    assert found.area_sd_px > 100
    assert found.mask.sum() * found.crop.pixel_size.prod() == pytest.approx(found.area_px, rel=0.02)
    assert HIDDEN_MARGIN in (found.without_scale().note or "")


def draw_bare(image: np.ndarray) -> None:
    del image


def draw_shadow(image: np.ndarray) -> None:
    shade = np.ones((SIDE, SIDE), np.float32)
    cv2.ellipse(shade, (325, 325), LEAF[1], 25, 0, 360, 0.45, -1)
    image *= cv2.GaussianBlur(shade, (0, 0), 8)[..., None]


def draw_label(image: np.ndarray) -> None:
    image[330:420, 200:560] = PAPER


def draw_ring(image: np.ndarray) -> None:
    """The leaf was traced with a pen."""
    cv2.ellipse(image, LEAF[0], (LEAF[1][0] + 9, LEAF[1][1] + 9), 25, 0, 360, (70, 70, 160), 7, cv2.LINE_AA)


def draw_gloss(image: np.ndarray) -> None:
    paint(image, ((430, 330), (40, 25)), PAPER)


@pytest.mark.parametrize(
    ("draw", "is_touched"),
    [(draw_bare, False), (draw_shadow, False), (draw_gloss, False), (draw_label, True)],
)
def test_what_is_no_margin_adds_nothing(draw: Callable[[np.ndarray], None], is_touched: bool) -> None:
    camera = make_camera(6.0, 0.2)
    image = draw_sheet(camera)
    draw(image)
    paint(image, LEAF, GREEN)
    found = find_margin(image, camera)
    assert found.area_px == pytest.approx(np.pi * np.prod(LEAF[1]), rel=0.02)
    assert found.is_touched == is_touched
    assert not found.has_hidden_margin


def test_print_too_faint_or_too_fine_tells_nothing() -> None:
    faint, fine = make_camera(6.0, 0.2), make_camera(2.0, 0.2)
    for camera, strength in ((faint, 0.01), (fine, 0.3)):
        image = draw_sheet(camera, strength=strength)
        paint(image, MARGIN, PAPER)
        paint(image, LEAF, GREEN)
        assert not find_margin(image, camera).has_hidden_margin


def test_print_is_seen_in_shadow_and_not_under_what_covers_it() -> None:
    camera = make_camera(5.0, 0.3)
    image = draw_sheet(camera)
    image[:, 400:] *= 0.5
    image[100:200, 100:200] = PAPER
    photo = PhotoPyramid(add_noise(image))
    hidden = np.zeros((SIDE, SIDE), bool)
    seen = measure_visibility(photo.photo, camera, 1.0, hidden, PrintVisibilityParams())
    assert seen is not None
    assert seen.px_per_line == pytest.approx(5.0, rel=1e-3)
    assert np.median(seen.share[:, 430:]) == pytest.approx(1, abs=0.15)
    assert np.abs(seen.share[120:180, 120:180]).max() < 0.3
    assert seen.is_known.mean() > 0.95


@pytest.mark.parametrize("gap", [6, 9, 10, 14])
def test_bare_paper_between_lobes_is_no_margin(gap: int) -> None:
    camera = make_camera(5.0, 0.2)
    mask = np.zeros((SIDE, SIDE), np.uint8)
    cv2.rectangle(mask, (200, 280), (400, 310), 1, -1)
    for left in range(200, 400 - gap, 30 + gap):
        cv2.rectangle(mask, (left, 180), (left + 30, 280), 1, -1)
    image = draw_sheet(camera)
    image[mask > 0] = GREEN
    found = find_margin(image, camera, mask > 0)
    assert not found.has_hidden_margin
    assert found.area_px == pytest.approx(int(mask.sum()), rel=0.02)


def test_holes_of_a_leaf_stay_beside_its_margin() -> None:
    camera = make_camera(6.0, 0.2)
    image, mask = draw_sheet(camera), GREEN_PART.copy()
    paint(image, MARGIN, PAPER)
    for top in range(260, 340, 16):
        for left in range(220, 380, 16):
            mask[top : top + 4, left : left + 4] = False
    image[mask] = GREEN
    before = len(outline_mask(PhotoPyramid(add_noise(image)), mask).polygon.holes)
    found = find_margin(image, camera, mask)
    assert found.has_hidden_margin
    assert before == 50
    assert len(found.polygon.holes) == before


def test_a_small_leaf_has_a_margin_too() -> None:
    camera = make_camera(6.0, 0.2)
    image = draw_sheet(camera)
    paint(image, ((300, 300), (50, 40)), PAPER)
    paint(image, ((300, 300), (36, 26)), GREEN)
    found = find_margin(image, camera, fill_ellipse((300, 300), (36, 26)))
    assert found.has_hidden_margin
    assert abs(found.area_px - np.pi * 50 * 40) < 2.5 * found.area_sd_px < 0.3 * found.area_px


def test_another_leaf_is_no_margin() -> None:
    camera = make_camera(6.0, 0.2)
    image, other = draw_sheet(camera), fill_ellipse((330, 420), (150, 30))
    image[other] = GREEN
    paint(image, LEAF, GREEN)
    found = find_margin(image, camera, others=[trace_polygons(other)[0].outer])
    assert not found.has_hidden_margin


@pytest.mark.parametrize("line_px", [250.0, 1500.0])
def test_lines_far_apart_tell_nothing(line_px: float) -> None:
    camera = make_camera(line_px, 0.2)
    mask = fill_ellipse((300, 300), (12, 8))
    image = np.full((SIDE, SIDE, 3), PAPER, np.float32)
    image[mask] = GREEN
    found = find_margin(image, camera, mask)
    assert not found.has_hidden_margin and not found.is_touched


def test_bare_paper_with_heavier_fourths_is_seen() -> None:
    camera = make_camera(5.0, 0.3)
    photo = PhotoPyramid(add_noise(draw_sheet(camera, levels={1: 0.5, 4: 1.0})))
    hidden = np.zeros((SIDE, SIDE), bool)
    seen = measure_visibility(photo.photo, camera, 1.0, hidden, PrintVisibilityParams())
    assert seen is not None
    assert (seen.share > 0.5).mean() > 0.97
