"""Lens and bent sheets: one map for ruling, leaf and label, that of the fit of a photo's ruling."""

import dataclasses
import math

import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import RENDERING_2, changed, filled, middle

from laesi_tf.common.sheet_model import to_lines
from laesi_tf.synthesis import sample_scene
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.camera.view import IMAGE_BORDER, CameraView, compute_view
from laesi_tf.synthesis.ranges import Probability
from laesi_tf.synthesis.renderer import compute_layout
from laesi_tf.synthesis.scene_layout import leaf_edges

SIZE = (300, 400)
BOX = np.array([[-50, -20], [50, -20], [50, 20], [-50, 20]], np.float32)
ANGLES = st.floats(-math.pi, math.pi)
FAST = settings(max_examples=25, deadline=None)
CAMERAS = {
    "k1": st.floats(-0.05, 0.05),
    "lens_x": st.floats(-0.2, 0.2),
    "lens_y": st.floats(-0.2, 0.2),
    "bend": st.floats(-0.03, 0.03),
    "bend_angle": ANGLES,
    "tilt_deg": st.floats(0, 20),
    "tilt_direction": ANGLES,
    "fill": st.floats(0.25, 0.86),
    "place_x": st.floats(0, 1),
}


def view_of(**camera: float | bool) -> CameraView:
    params = middle(CameraParams(), distorted=True, bent=True, tilted=True, **camera)
    return compute_view(params, tf.constant(BOX), SIZE, is_distorted=True)


def photo_grid() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(0, 401, 25.0), np.arange(0, 301, 25.0)), -1).astype(np.float32)


@FAST
@given(camera=st.fixed_dictionaries(CAMERAS))
def test_both_directions_agree_on_every_pixel(camera: dict[str, float]) -> None:
    view, points = view_of(**camera), photo_grid()
    sheet = view.to_sheet(tf.constant(points))
    np.testing.assert_allclose(view.to_photo(sheet), points, atol=0.02)
    by_fit = np.stack(to_lines(view.distortion.model, *np.moveaxis((points - [200, 150]) / 200, -1, 0)), -1)
    np.testing.assert_allclose(by_fit, sheet, atol=0.01)
    x, y = view.pixel_centres_to_sheet(SIZE)
    centres = view.to_sheet(tf.constant([[[0.5, 0.5], [399.5, 299.5]]]))[0]
    np.testing.assert_allclose([[x[0, 0], y[0, 0]], [x[-1, -1], y[-1, -1]]], centres, atol=0.01)


@FAST
@given(camera=st.fixed_dictionaries(CAMERAS))
def test_pixel_area_is_the_jacobian(camera: dict[str, float]) -> None:
    view, points = view_of(**camera), photo_grid()
    right, left, below, above = (
        view.to_sheet(tf.constant(points + step, tf.float32)).numpy().astype(np.float64)
        for step in ([2, 0], [-2, 0], [0, 2], [0, -2])
    )
    numeric = np.abs(np.linalg.det(np.stack([right - left, below - above], -1))) / 16
    np.testing.assert_allclose(view.mm2_per_px(tf.constant(points)), numeric, rtol=3e-3)


@FAST
@given(camera=st.fixed_dictionaries(CAMERAS))
def test_the_leaf_keeps_off_the_border(camera: dict[str, float]) -> None:
    corners = view_of(**camera).to_photo(tf.constant(BOX)).numpy()
    # Bent paper is placed with the tilt of a camera that differs a little: half the border is left.
    margin = 0.5 * IMAGE_BORDER * np.array([400, 300])
    assert (corners >= margin).all() and (corners <= [400, 300] - margin).all()


def test_no_distortion_is_the_homography() -> None:
    plain = compute_view(middle(CameraParams(), tilted=True), tf.constant(BOX), SIZE)
    flat = view_of(k1=0.0, bend=0.0)
    np.testing.assert_allclose(flat.to_px, plain.to_px, rtol=1e-4)
    points = tf.constant(photo_grid())
    np.testing.assert_allclose(flat.to_sheet(points), plain.to_sheet(points), atol=0.01)
    np.testing.assert_allclose(flat.mm2_per_px(points), plain.mm2_per_px(points), rtol=1e-4)


def test_barrel_distortion_draws_the_corners_inwards() -> None:
    barrel, pincushion = (view_of(k1=k1, bend=0.0, lens_x=0.0, lens_y=0.0) for k1 in (0.05, -0.05))
    corner = tf.constant([400.0, 300.0])
    for view, sign in ((barrel, 1), (pincushion, -1)):
        flat = view.distortion.to_flat(corner).numpy()
        assert (sign * (flat - [400, 300]) > 5).all()


def test_leaf_area_and_label_agree_under_distortion() -> None:
    strong = changed(
        RENDERING_2.with_passes(1),
        "camera",
        distorted=Probability(1.0),
        k1=(0.04, 0.05),
        bent=Probability(1.0),
        bend=(0.02, 0.03),
    )
    size, naive = (300, 300), []
    rows, columns = np.mgrid[:300, :300] + 0.5
    centres = tf.constant(np.stack([columns, rows], -1), tf.float32)
    for index in range(6):
        layout = compute_layout(sample_scene(5, index, strong), size)
        coverage = -filled(leaf_edges(layout, size), size).numpy()
        found = np.sum(coverage * layout.view.mm2_per_px(centres)) / 100
        assert found == pytest.approx(float(layout.area_cm2), rel=2e-3)
        assert float(layout.view.px_per_mm) > 0
        flat = layout.view._replace(distortion=None)
        naive.append(np.sum(coverage * flat.mm2_per_px(centres)) / 100 / float(layout.area_cm2) - 1)
    assert np.abs(naive).max() > 0.02
    off = dataclasses.replace(strong, without=frozenset({"lens", "bend"}))
    assert compute_layout(sample_scene(5, 0, off), size).view.distortion is None
