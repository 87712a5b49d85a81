"""The ruling's scale, against papers drawn with a known homography and against synthesised scenes."""

import math

import numpy as np
import pytest
import tensorflow as tf
from green import disk, photo
from hypothesis import given, settings
from hypothesis import strategies as st
from sheets import SIDE, drawn, jacobian

from laesi_tf.estimators.camera_fit import estimate_tilt_deg
from laesi_tf.estimators.ruling_reader.harmonics import MILLIMETRES
from laesi_tf.estimators.ruling_reader.patches import BORDER, FRAME
from laesi_tf.estimators.ruling_reader.reader import compile_graph, read_ruling
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
    ruling = read_ruling(image, rough_px_per_mm=px_per_mm * 1.15)
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


def test_graph_and_its_conversion_agree():
    litert = pytest.importorskip("ai_edge_litert.interpreter", reason="needs the extra litert")
    image, _ = drawn(px_per_mm=6.0, turn=0.4, tilt=(0.1, -0.05))
    picture = np.zeros((FRAME, FRAME), np.uint8)
    picture[BORDER : BORDER + SIDE, BORDER : BORDER + SIDE] = image.min(axis=2)
    inputs = {
        "picture": picture,
        "size": np.int32([SIDE, SIDE]),
        "view": np.float32([0, 40, 450]),
        "weights": MILLIMETRES,
    }
    converter = tf.lite.TFLiteConverter.from_concrete_functions(
        [compile_graph().get_concrete_function()], compile_graph()
    )
    converter.target_spec.supported_ops = [tf.lite.OpsSet.TFLITE_BUILTINS]
    interpreter = litert.Interpreter(model_content=converter.convert())
    interpreter.allocate_tensors()
    for detail in interpreter.get_input_details():
        interpreter.set_tensor(detail["index"], inputs[detail["name"]])
    interpreter.invoke()
    converted = [interpreter.get_tensor(detail["index"]) for detail in interpreter.get_output_details()]
    for ours, theirs in zip(compile_graph()(**inputs), converted, strict=True):
        np.testing.assert_allclose(theirs, ours, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("tilt", [0.0, 3.0, 12.0, 20.0])
@pytest.mark.parametrize("focal", [0.8, 1.5])
def test_tilt_of_a_pinhole(tilt, focal):
    angle = math.radians(tilt)
    turned = np.array(
        [[1, 0, 0], [0, math.cos(angle), -math.sin(angle)], [0, math.sin(angle), math.cos(angle)]]
    )
    camera = np.array([[focal * 800, 0, 400], [0, focal * 800, 300], [0, 0, 1]])
    to_px = camera @ np.column_stack([turned[:, 0], turned[:, 1], [5, -8, 150]])
    found = estimate_tilt_deg(np.linalg.inv(to_px), (600, 800))
    assert found == pytest.approx(tilt, abs=0.01)


def test_a_clear_sheet_is_read_with_confidence():
    sure = read_ruling(drawn(px_per_mm=6.0, turn=0.3)[0])
    assert sure is not None and sure.confidence > 0.9
    assert 0 <= sure.tilt_deg < 2


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
        ruling = read_ruling(
            scene["image"].numpy(), leaf=mask, rough_px_per_mm=float(scene["px_per_mm"]) * 1.1
        )
        if ruling is not None:
            rows, columns = np.nonzero(mask)
            area = ruling.mm2_per_px(np.stack([columns, rows], axis=1) + 0.5).sum() / 100
            errors.append(abs(area / float(scene["area_cm2"]) - 1))
    assert len(errors) >= 8
    assert np.median(errors) < 0.01


@pytest.mark.parametrize("side", [96, 150, 300, 401, 800])
def test_where_nothing_is_printed_nothing_is_read(side):
    disc = disk(side, side)
    assert read_ruling(photo(side, side), leaf=disc) is None
    assert read_ruling(np.full((side, side, 3), 200, np.uint8)) is None
