"""Kinds of paper: what a scene says about its printed lines is what is printed."""

import dataclasses

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, changed, middle

from laesi_tf.synthesis import sample_scene
from laesi_tf.synthesis.paper.kinds import (
    PAPER_KINDS,
    crossed_periods_mm,
    place_in_period,
)
from laesi_tf.synthesis.paper.params import KIND_NAMES, PaperParams
from laesi_tf.synthesis.paper.ruling import (
    compute_ink_absorbance,
    kind_cells,
    line_profiles,
    look_up_line_coverage,
    pack_kind_transmission,
    pack_line_transmission,
    ruling_cells,
)
from laesi_tf.synthesis.presets import PRESETS
from laesi_tf.synthesis.ranges import choice

KIND = choice(*KIND_NAMES)
TRUTH = {
    "millimetre": (1.0, 10.0),
    "mm_1_2_10": (1.0, 10.0),
    "mm_2_10": (2.0, 10.0),
    "mm_4": (4.0, 4.0),
    "mm_5": (5.0, 5.0),
    "quarter_inch": (6.35, 25.4),
    "tenth_inch": (2.54, 25.4),
    "lines": (0.0, 0.0),
    "plain": (0.0, 0.0),
}


def sheet_of(kind: str, **given: float | bool) -> PaperParams:
    lines = {"has_5mm": True, "has_10mm": True, "strength_1mm": 0.8, "ink_spread_mm": 0.04}
    return middle(PaperParams(), kind=float(KIND_NAMES.index(kind)), **(lines | given))


def strongest_period(sheet: PaperParams, *, axis: int) -> float:
    """Return the period in mm of the strongest wave along x (axis 0) or y of a sheet; 0 without any."""
    length, samples = 2540, 2540  # mm: a whole number of every period
    along, across = np.meshgrid(np.arange(0, length, 0.2), np.linspace(0, 25.4, 50), indexing="ij")
    x, y = (tf.constant(place, tf.float32) for place in ((along, across), (across, along))[axis])
    transmission = pack_kind_transmission(sheet, samples, tf.constant(0.05))
    coverage = look_up_line_coverage(transmission, kind_cells(sheet, samples, x, y), dotted=sheet.dotted)
    profile = compute_ink_absorbance(sheet, *coverage).numpy()[1].mean(axis=1)
    spectrum = np.abs(np.fft.rfft(profile - profile.mean()))
    return length / int(np.argmax(spectrum)) if spectrum.max() > 1 else 0.0


def test_every_kind_has_its_name_and_truth() -> None:
    assert tuple(PAPER_KINDS) == KIND_NAMES == tuple(TRUTH)


@pytest.mark.parametrize("dotted", [False, True])
@pytest.mark.parametrize("kind", TRUTH)
def test_printed_lines_have_the_periods_that_the_scene_states(kind: str, dotted: bool) -> None:
    fine = sheet_of(kind, dotted=dotted, strength_5mm=0.0, strength_10mm=0.0)
    periods = crossed_periods_mm(fine).numpy()
    finest, heaviest = float(periods[0]), float(periods.max())
    assert (finest, heaviest) == pytest.approx(TRUTH[kind])
    if kind != "lines":
        for axis in (0, 1):
            assert strongest_period(fine, axis=axis) == pytest.approx(finest, rel=1e-3)
    if heaviest > finest:
        heavy = sheet_of(kind, dotted=dotted, strength_1mm=0.0, strength_5mm=0.0, strength_10mm=0.9)
        assert strongest_period(heavy, axis=0) == pytest.approx(heaviest, rel=1e-3)


def test_lines_run_in_one_direction() -> None:
    sheet = sheet_of("lines", spacing_mm=10.0)
    assert strongest_period(sheet, axis=0) == 0
    assert strongest_period(sheet, axis=1) == pytest.approx(10, rel=1e-3)


def test_millimetre_paper_of_either_way_is_the_same() -> None:
    """The sum of sines of any kind gives the lines of the paper's presets."""
    sheet = sheet_of("millimetre", phase_x=0.0, phase_y=0.0)
    place = (np.arange(1000) + 0.5) / 100
    x, y = (tf.constant(axis, tf.float32) for axis in np.meshgrid(place, place[::50]))
    by_kind = look_up_line_coverage(
        pack_kind_transmission(sheet, 1000, tf.constant(0.2)), kind_cells(sheet, 1000, x, y)
    )
    usual = look_up_line_coverage(
        pack_line_transmission(sheet, 100, tf.constant(0.2)), ruling_cells(sheet, 100, x, y)
    )
    assert line_profiles(sheet, 100, tf.constant(0.2)).shape == (3, 1000)
    np.testing.assert_allclose(np.stack(by_kind), np.stack(usual), atol=0.01)


def test_left_out_kinds_leave_millimetre_paper() -> None:
    phone = PRESETS["phone"]
    plain = changed(phone, "paper", kind=KIND.with_weights(plain=1.0))
    assert float(sample_scene(0, 0, plain).printed_periods_mm[0]) == 0
    without = dataclasses.replace(plain, without=frozenset({"paper_kinds"}))
    scene = sample_scene(0, 0, without)
    assert float(scene.printed_periods_mm[0]) == 1 and "paper_kinds" not in scene.components
    assert not RENDERING_2.has("paper_kinds") and phone.has("paper_kinds")
    bare = dataclasses.replace(phone, without=frozenset({"ruling"}))
    assert not sample_scene(0, 0, bare).printed_periods_mm.numpy().any()


@pytest.mark.parametrize("kind", [name for name, (finest, _) in TRUTH.items() if finest])
def test_ink_is_darkest_on_lines_that_belong_to_all_families(kind: str) -> None:
    sheet = sheet_of(kind, phase_x=3.7, phase_y=8.1)
    place = tf.range(0.0, 30.0, 0.01)[None]
    distances = place_in_period(sheet, place, place).numpy() * PAPER_KINDS[kind].period_mm
    period = float(crossed_periods_mm(sheet).numpy().max())
    transmission = pack_kind_transmission(sheet, 2540, tf.constant(0.05))
    for axis in range(2):
        only = [place if axis == along else tf.fill(place.shape, place[0, 0]) for along in range(2)]
        coverage = look_up_line_coverage(transmission, kind_cells(sheet, 2540, *only), dotted=sheet.dotted)
        ink = compute_ink_absorbance(sheet, *coverage).numpy()[1]
        off = np.abs(distances[axis] - period * np.round(distances[axis] / period))
        assert ink[off < 0.02].min() > 0.95 * ink.max()
