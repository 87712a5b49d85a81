"""The ruling's scale, against papers drawn with a known homography and against synthesised scenes."""

import math

import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from sheets import SIDE, drawn, jacobian

from laesi_tf.estimators.ruling import read_ruling
from laesi_tf.synthesis import load_ranges, synthesise


@settings(max_examples=12, deadline=None)
@given(
    px_per_mm=st.floats(3.5, 9.0),
    turn=st.floats(-math.pi, math.pi),
    tilt=st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15)),
    heavy=st.sampled_from([5, 10]),
)
def test_any_view_of_a_drawn_sheet(px_per_mm, turn, tilt, heavy):
    image, forward = drawn(px_per_mm=px_per_mm, turn=turn, tilt=tilt, heavy=heavy)
    ruling = read_ruling(image, about=px_per_mm * 1.15)
    assert ruling is not None
    points = np.array([[SIDE / 2, SIDE / 2], [SIDE / 5, SIDE / 3], [SIDE * 0.8, SIDE * 0.7]])
    true = [jacobian(forward, point) for point in points]
    np.testing.assert_allclose(ruling.mm2_per_px(points), true, rtol=0.01)


def test_the_family_of_lines_is_decided_without_help():
    for heavy in (5, 10):
        image, _ = drawn(px_per_mm=5.0, turn=0.3, heavy=heavy)
        ruling = read_ruling(image)
        assert ruling is not None
        assert ruling.px_per_mm(np.array([300.0, 300.0])) == pytest.approx(5.0, rel=0.005)


def test_another_ruling_works_by_its_number():
    image, _ = drawn(px_per_mm=8.0, turn=1.0)
    ruling = read_ruling(image, grid_mm=5.0)
    assert ruling is not None
    assert ruling.px_per_mm(np.array([300.0, 300.0])) == pytest.approx(8.0 / 5.0, rel=0.005)


@pytest.mark.parametrize("level", [0, 127, 255])
def test_plain_and_noisy_pictures_have_no_ruling(level):
    plain = np.full((400, 500, 3), level, np.uint8)
    noisy = np.clip(plain + np.random.default_rng(1).normal(0, 20, plain.shape), 0, 255).astype(np.uint8)
    assert read_ruling(plain) is None
    assert read_ruling(noisy) is None


def test_scenes_with_tilt_are_read_to_a_percent():
    ranges = load_ranges("rendering_2")
    errors = []
    make = tf.function(lambda index: synthesise(5, size=(768, 768), ranges=ranges, index=index))
    for index in range(0, 40, 4):
        scene = make(tf.constant(index, tf.int64))
        mask = scene["mask"].numpy() > 0
        ruling = read_ruling(scene["image"].numpy(), leaf=mask, about=float(scene["px_per_mm"]) * 1.1)
        if ruling is not None:
            rows, columns = np.nonzero(mask)
            area = ruling.mm2_per_px(np.stack([columns, rows], axis=1) + 0.5).sum() / 100
            errors.append(abs(area / float(scene["area_cm2"]) - 1))
    assert len(errors) >= 8
    assert np.median(errors) < 0.01
