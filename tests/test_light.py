"""Shadows, shading and reflections."""

import math

import cv2
import numpy as np
import pytest
import tensorflow as tf
from scenes import middle

from laesi_tf.synthesis import filters, light
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.random_streams import RandomStreams
from laesi_tf.synthesis.scene_numbers import sample_light_numbers

SIZE = (120, 160)
GRID = sample_light_numbers(RandomStreams(0, 0)).illumination


def disk() -> np.ndarray:
    rows, columns = np.indices(SIZE) + 0.5
    return ((rows - 60) ** 2 + (columns - 80) ** 2 < 25**2).astype(np.float32)


def light_beside(disk: np.ndarray, light_params: LightParams) -> np.ndarray:
    """Return the light [H, W] on a white sheet beside `disk`, at 4 pixels per mm."""
    depth = light.shadow_depth(tf.constant(disk), light_params, SIZE, tf.constant(4.0))
    return light.apply_shadow(tf.ones(SIZE), depth, light_params).numpy()


def centre_of(field: np.ndarray) -> np.ndarray:
    """Return the centroid (x, y)."""
    rows, columns = np.indices(field.shape) + 0.5
    return np.array([(columns * field).sum(), (rows * field).sum()]) / field.sum()


@pytest.mark.parametrize("sigma", [5.0, 9.0])
def test_blur_and_shift_is_a_gaussian_blur(sigma: float) -> None:
    expected = cv2.GaussianBlur(disk(), (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    found = filters.blur_and_shift(tf.constant(disk()), SIZE, tf.constant(sigma)).values.numpy()
    # Blocks of four pixels widen it by 4 / sqrt(12) px in quadrature.
    np.testing.assert_allclose(found, expected, atol=0.02)


@pytest.mark.parametrize("angle", [0.0, 1.2, -2.5])
def test_shadow_falls_where_light_travels(angle: float) -> None:
    light_params = middle(LightParams(), strength=0.5, direction=angle, offset_mm=3.0, softness_mm=1.0)
    left = light_beside(disk(), light_params)
    moved = centre_of(1 - left) - centre_of(disk())
    np.testing.assert_allclose(moved, [12 * math.cos(angle), 12 * math.sin(angle)], atol=0.1)
    assert left.min() == pytest.approx(0.5, abs=0.01) and left.max() <= 1


def test_shadow_without_strength_removes_no_light() -> None:
    light_params = middle(LightParams(), strength=0.0)
    assert (light_beside(disk(), light_params) == 1).all()


def test_larger_size_makes_a_softer_edge() -> None:
    steepest = []
    for softness in (0.5, 3.0):
        light_params = middle(LightParams(), strength=0.5, softness_mm=softness)
        left = light_beside(disk(), light_params)
        steepest.append(np.abs(np.diff(left, axis=1)).max())
    assert steepest[0] > 2 * steepest[1] > 0


def even_light(**given: float | bool) -> LightParams:
    """Return even light with the `given` exceptions."""
    none = {"slope": 0.0, "vignette": 0.0, "unevenness": 0.0, "cast": False}
    return middle(LightParams(), **(none | given))


def test_even_light_is_one() -> None:
    np.testing.assert_allclose(
        light.illumination(even_light(), GRID, SIZE),
        1,
        atol=1e-4,
    )


def test_slope_brightens_towards_where_light_travels() -> None:
    field = light.illumination(even_light(slope=0.4, direction=0.0), GRID, SIZE).numpy()
    assert (np.diff(field[60]) > 0).all() and np.ptp(field[:, 80]) < 1e-3
    assert field[60, -1] - field[60, 0] == pytest.approx(0.4, abs=0.05)


def test_vignette_darkens_corners() -> None:
    field = light.illumination(even_light(vignette=0.3), GRID, (160, 160)).numpy()
    assert field[80, 80] == pytest.approx(1, abs=0.01) and field[0, 0] == pytest.approx(0.85, abs=0.03)


@pytest.mark.parametrize("size", [(80, 160), (160, 80)])
def test_light_is_symmetric_about_the_image_centre(size: tuple[int, int]) -> None:
    field = light.illumination(even_light(vignette=0.3), GRID, size).numpy()
    np.testing.assert_allclose(field, field[::-1, ::-1], atol=0.01)


def test_cast_shadow_darkens_one_side_by_its_strength() -> None:
    light_params = even_light(
        cast=True, cast_strength=0.5, cast_softness=0.02, cast_offset=0.0, cast_angle=0.0
    )
    field = light.illumination(light_params, GRID, SIZE).numpy()
    assert field[60, 5] == pytest.approx(1, abs=0.02) and field[60, 155] == pytest.approx(0.5, abs=0.02)


def test_flat_surface_keeps_its_colour() -> None:
    colour = tf.constant(np.random.default_rng(0).uniform(size=(3, 8, 9)).astype(np.float32))
    light_params = middle(LightParams(), gloss=0.3)
    flat = light.slope_towards_light((tf.zeros([8, 9]), tf.zeros([8, 9])), light_params)
    np.testing.assert_allclose(light.shade_relief(colour, flat, light_params), colour)


def test_slopes_towards_the_light_are_brighter() -> None:
    light_params = middle(LightParams(), direction=0.0, relief=0.5, gloss=0.2)
    slopes = tf.constant([[-0.4, 0.0, 0.4]]), tf.zeros([1, 3])
    towards, flat, away = light.shade_relief(
        tf.fill([3, 1, 3], 0.5), light.slope_towards_light(slopes, light_params), light_params
    ).numpy()[0, 0]
    assert away == pytest.approx(0.4) and flat == pytest.approx(0.5)
    assert towards == pytest.approx(0.6 + 0.2 * 0.35**2)


def test_glass_lifts_shadows_within_its_pane() -> None:
    image = tf.fill([3, *SIZE], 0.3)
    through = middle(LightParams(), glass=True, glass_strength=0.4, glass_veil=0.05, glass_width=0.2)
    seen = light.add_glass_reflection(image, light.glass_reflection(through, SIZE)).numpy()
    assert seen.min() == pytest.approx(0.3 + 0.05 * 0.67, abs=5e-3)
    assert seen.max() == pytest.approx(0.3 + 0.45 * 0.67, abs=0.02)
    without = light.glass_reflection(middle(LightParams(), glass=False), SIZE)
    np.testing.assert_array_equal(light.add_glass_reflection(image, without), image)


@pytest.mark.parametrize("size", [(160, 160), (80, 160), (160, 80)])
def test_light_is_measured_from_the_image_centre_to_its_borders(size: tuple[int, int]) -> None:
    """The fall-off is linear, exactly `slope` over the longer side; it is 1 in the middle."""
    field = light.illumination(
        even_light(slope=0.4, direction=math.pi / 4), tf.fill([8, 8], 0.5), size
    ).numpy()
    rows, columns = (np.indices(size) + 0.5 - np.array(size).reshape(2, 1, 1) / 2) / max(size)
    expected = 1 + 0.4 * math.sqrt(0.5) * (rows + columns)
    np.testing.assert_allclose(field, expected, atol=2e-4)


def test_the_photographers_shadow_is_a_rectangle_of_its_strength() -> None:
    given = {
        "photographer_strength": 0.4,
        "photographer_x": 0.0,
        "photographer_y": 0.2,
        "photographer_angle": 0.0,
    }
    sizes = {"photographer_width": 0.1, "photographer_length": 0.2, "photographer_softness": 0.01}
    there, not_there = (
        light.photographer_shadow(
            middle(LightParams(), photographer=is_there, **given, **sizes), (200, 200)
        ).numpy()
        for is_there in (True, False)
    )
    assert (not_there == 1).all()
    assert there[140, 100] == pytest.approx(0.6, abs=0.01) and there[60, 100] == pytest.approx(1, abs=0.01)
    # Half of the light is lost where the rectangle ends: 0.2 wide and 0.4 long.
    assert np.mean(there < 0.8) == pytest.approx(0.08, abs=0.015)


def test_glare_is_brightest_in_its_middle() -> None:
    spot = middle(LightParams(), glare=True, glare_strength=0.5, glare_x=0.25, glare_y=-0.1, glare_size=0.1)
    made = light.glare_reflection(spot, (120, 160)).numpy()
    row, column = np.unravel_index(made.argmax(), made.shape)
    assert abs(row - 44) <= 3 and abs(column - 120) <= 3
    assert made.max() == pytest.approx(0.5, abs=0.03) and made.min() >= -0.01
