"""The sheet and its ruling against direct evaluation, and measured on images."""

import colorsys
import dataclasses
import itertools

import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import RENDERING_2, changed, middle, only

from laesi_tf.synthesis import Ranges, colour, synthesise
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.paper.ruling import (
    compute_ink_absorbance,
    line_profiles,
    look_up_line_coverage,
    pack_line_transmission,
    ruling_cells,
)
from laesi_tf.synthesis.paper.sheet import (
    GRADIENT_NODES,
    SIMPLE_NODES,
    crease_shading,
    distance_to_sheet_edge,
    paper_noise,
)
from laesi_tf.synthesis.random_streams import RandomStreams
from laesi_tf.synthesis.ranges import Probability
from laesi_tf.synthesis.scene_numbers import sample_scene_numbers

UNIT = st.floats(0, 1, width=32)


def blurred_line(
    position: np.ndarray, pitch: float, width: float, spread: float, footprint: float
) -> np.ndarray:
    """Coverage by lines of `width` every `pitch` mm: the integral of what blurs them, without a series."""
    fine = np.arange(-200 * 20, 200 * 20 + 1) / 2000
    pixel = np.clip(1 - np.abs(fine) / footprint, 0, None)
    ink = np.exp(-0.5 * (fine / spread) ** 2)
    kernel = np.convolve(pixel / pixel.sum(), ink / ink.sum(), mode="same")
    places = (position[:, None] - fine + pitch / 2) % pitch - pitch / 2
    return (np.abs(places) <= width / 2) @ kernel


@pytest.mark.parametrize("footprint", [0.1, 0.35, 0.7])
def test_line_profiles_are_blurred_lines(footprint: float) -> None:
    sheet = middle(PaperParams(), width_1mm=0.2, width_5mm=0.3, width_10mm=0.4, ink_spread_mm=0.08)
    found = line_profiles(sheet, 20, tf.constant(footprint)).numpy()
    position = (np.arange(200) + 0.5) / 20
    for row, (pitch, width) in zip(found, ((1, 0.2), (5, 0.3), (10, 0.4)), strict=True):
        np.testing.assert_allclose(row, blurred_line(position, pitch, width, 0.08, footprint), atol=0.02)


def test_wide_ink_leaves_the_papers_single_sine() -> None:
    sheet = middle(PaperParams(), ink_spread_mm=0.3, width_1mm=0.5)
    profile = line_profiles(sheet, 20, tf.constant(0.01)).numpy()[0]
    wave = np.cos(2 * np.pi * (np.arange(200) + 0.5) / 20)
    amplitude = 2 * np.mean(profile * wave)
    assert amplitude > 0.05
    np.testing.assert_allclose(profile, 0.5 + amplitude * wave, atol=2e-4)


def test_a_grid_finer_than_the_pixels_fades_to_its_mean() -> None:
    sheet = middle(PaperParams(), width_1mm=0.3, ink_spread_mm=0.02)
    swing = {}
    for footprint in (0.1, 0.5, 1.0):
        profile = line_profiles(sheet, 20, tf.constant(footprint)).numpy()[0]
        assert profile.mean() == pytest.approx(0.3, abs=2e-3)
        swing[footprint] = np.ptp(profile)
    assert swing[0.1] > 0.9 and 0.1 < swing[0.5] < 0.5 and swing[1.0] < 0.01


def absorbance_at(
    sheet: PaperParams, x: np.ndarray, y: np.ndarray, samples: int, footprint: float
) -> np.ndarray:
    """Absorbance [3, H, W] at `x` and `y` [H, W] mm."""
    passing = pack_line_transmission(sheet, samples, tf.constant(footprint))
    where = ruling_cells(sheet, samples, tf.constant(x, tf.float32), tf.constant(y, tf.float32))
    lines = look_up_line_coverage(passing, where)
    return compute_ink_absorbance(sheet, *lines).numpy()


def absorbance_of_one_period(sheet: PaperParams, samples: int, footprint: float) -> np.ndarray:
    """Absorbance [3, n, n] over one period from its beginning, rows along y."""
    at_start = dataclasses.replace(sheet, phase_x=tf.constant(0.0), phase_y=tf.constant(0.0))
    places = (np.arange(10 * samples) + 0.5) / samples
    return absorbance_at(at_start, *np.meshgrid(places, places), samples, footprint)


@settings(max_examples=10, deadline=None)
@given(x=st.floats(-300, 300), y=st.floats(-300, 300), phase=st.floats(0, 10))
def test_ruling_is_the_tile_repeated(x: float, y: float, phase: float) -> None:
    sheet = middle(PaperParams(), has_5mm=True, has_10mm=True, phase_x=phase, phase_y=3.0)
    tile = absorbance_of_one_period(sheet, 40, 0.3)
    found = absorbance_at(sheet, np.array([[x]]), np.array([[y]]), 40, 0.3)[:, 0, 0]
    row, column = (int(np.floor((place % 10) * 40)) % 400 for place in (y + 3, x + phase))
    around = [
        tile[:, (row + i) % 400, (column + j) % 400] for i, j in itertools.product((-1, 0, 1), repeat=2)
    ]
    assert min(np.abs(found - near).max() for near in around) < 1e-5


def test_lines_of_either_axis_run_along_it() -> None:
    sheet = middle(PaperParams(), has_5mm=False, has_10mm=False, strength_10mm=0.0, ink_spread_mm=0.02)
    tile = absorbance_of_one_period(sheet, 20, 0.05).max(axis=0)
    between_lines, on_line = tile[10, 10], (tile[0, 10], tile[10, 0])
    assert min(on_line) > between_lines + 0.1


def test_a_sheet_has_5_or_10_mm_lines() -> None:
    without = middle(PaperParams(), has_5mm=False, has_10mm=False, strength_1mm=0.0)
    assert np.ptp(absorbance_of_one_period(without, 20, 0.1)) > 0.05


def ranges_of_bare_sheet(**camera: object) -> Ranges:
    """Return ranges of 1 mm lines on an untilted sheet, parallel to the image borders."""
    lines = {"width_1mm": (0.25, 0.3), "strength_1mm": (0.9, 1.0), "strength_10mm": 0.0}
    ink = {
        "ink_spread_mm": 0.03,
        "ink_darkness": (0.6, 0.7),
        "has_5mm": Probability(0.0),
        "has_10mm": Probability(0.0),
    }
    ranges = changed(only("ruling"), "paper", **lines, **ink)
    return changed(ranges, "camera", **({"tilted": Probability(0.0), "roll": 0.0, "place_x": 1.0} | camera))


def test_measured_pitch_is_the_scale() -> None:
    for index in range(4):
        made = synthesise(3, size=(512, 512), ranges=ranges_of_bare_sheet(farthest_mm=150), index=index)
        leafless = ~made["mask"].numpy().any(axis=1)
        signal = made["image"].numpy()[leafless].astype(float).mean(axis=(0, 2))
        window = np.hanning(512)
        spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * window, 512 * 256))
        frequency = np.fft.rfftfreq(512 * 256)
        near = (frequency > 1 / 10) & (frequency < 1 / 2.5)
        pitch = 1 / frequency[near][np.argmax(spectrum[near])]
        assert pitch == pytest.approx(float(made["px_per_mm"]), rel=0.002)


def test_a_distant_grid_does_not_alias() -> None:
    ranges = ranges_of_bare_sheet(farthest_mm=230, closest_mm=230, fill=0.1)
    made = synthesise(3, size=(224, 224), ranges=ranges, index=0)
    assert float(made["px_per_mm"]) < 1
    sheet = made["image"].numpy()[made["mask"].numpy() == 0].astype(float)
    near = synthesise(3, size=(224, 224), ranges=ranges_of_bare_sheet(farthest_mm=70, closest_mm=70), index=0)
    lined = near["image"].numpy()[near["mask"].numpy() == 0].astype(float)
    assert sheet.std(axis=0).max() < 2.5 and lined.std(axis=0).max() > 8


@settings(max_examples=30, deadline=None)
@given(hue=UNIT, saturation=UNIT)
def test_hsv_to_rgb_equals_colorsys(hue: float, saturation: float) -> None:
    found = colour.hsv_to_rgb(tf.constant(hue), tf.constant(saturation))
    np.testing.assert_allclose(found, colorsys.hsv_to_rgb(hue, saturation, 1), atol=1e-4)


def test_distance_to_sheet_edge_is_that_to_the_nearest_side() -> None:
    sheet = middle(PaperParams(), left=10.0, right=20.0, top=5.0, bottom=40.0)
    leaf = tf.constant([[-30.0, -10.0], [30.0, 10.0], [0.0, 4.0]])
    x, y = np.meshgrid(np.linspace(-60, 80, 15), np.linspace(-30, 70, 11))
    found = distance_to_sheet_edge(sheet, leaf, tf.constant(x, tf.float32), tf.constant(y, tf.float32))
    sides = np.stack([x + 40, 50 - x, y + 15, 50 - y])
    np.testing.assert_allclose(found, sides.min(axis=0), atol=1e-4)


def test_wear_weakens_the_ink_and_noise_has_its_weights() -> None:
    still = middle(PaperParams(), gradient_weight=0.0, voronoi_weight=0.0, simple_weight=0.0, print_wear=0.0)
    blend, strength = paper_noise(still, sample_scene_numbers(RandomStreams(0, 0)).sheet, (40, 60))
    assert not blend.numpy().any() and (strength.numpy() == 1).all()
    worn = middle(PaperParams(), print_wear=0.5, gradient_weight=0.2)
    blend, strength = paper_noise(worn, sample_scene_numbers(RandomStreams(0, 0)).sheet, (40, 60))
    assert 0.5 <= strength.numpy().min() < 0.9 and strength.numpy().max() <= 1
    assert 0.05 < np.abs(blend.numpy()).max() < 0.5


def test_crease_has_a_brighter_and_a_darker_flank() -> None:
    sheet = middle(PaperParams(), crease_angle=0.0, crease_offset=0.1, crease_depth=0.1)
    x = np.linspace(-20, 40, 601, dtype=np.float32)[None]
    shade = crease_shading(sheet, tf.constant(x), tf.zeros_like(x), tf.constant(100.0)).numpy()[0]
    assert shade.sum() == pytest.approx(0, abs=1e-3)
    middle_mm = (x[0, shade.argmax()] + x[0, shade.argmin()]) / 2
    assert middle_mm == pytest.approx(10, abs=0.2)
    assert 0.06 < shade.max() < 0.1


def test_defaults_stay_within_the_noise_grids() -> None:
    sheet = RENDERING_2.paper
    assert sheet.simple_cells[1] <= SIMPLE_NODES - 3
    assert sheet.gradient_cells[1] <= GRADIENT_NODES - 1
