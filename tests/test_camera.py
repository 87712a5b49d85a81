"""The camera against OpenCV, numeric derivatives and a camera in three dimensions."""

import math

import cv2
import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import middle

from laesi_tf.synthesis import filters, geometry
from laesi_tf.synthesis.camera import imaging, recording
from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.camera.view import IMAGE_BORDER, CameraView, compute_view, pinhole_homography

ANGLES = st.floats(-math.pi, math.pi)
FAST = settings(max_examples=25, deadline=None)
LUMA = np.array([0.299, 0.587, 0.114])
BOX = np.array([[-50, -20], [50, -20], [50, 20], [-50, 20]], np.float32)


def view_of(size: tuple[int, int] = (300, 400), **given: float | bool) -> CameraView:
    return compute_view(middle(CameraParams(), **given), tf.constant(BOX), size)


def tilted_view(tilt: float, direction: float, roll: float) -> CameraView:
    return view_of(tilted=True, tilt_deg=tilt, tilt_direction=direction, roll=roll)


def random_image(seed: int = 0, size: tuple[int, int] = (40, 50)) -> np.ndarray:
    return np.random.default_rng(seed).uniform(size=(3, *size)).astype(np.float32)


@FAST
@given(tilt=st.floats(0, 20), direction=ANGLES, roll=ANGLES)
def test_projection_equals_opencv(tilt: float, direction: float, roll: float) -> None:
    to_px = tilted_view(tilt, direction, roll).to_px
    points = np.random.default_rng(0).uniform(-60, 60, (30, 2)).astype(np.float32)
    expected = cv2.perspectiveTransform(points[None].astype(np.float64), to_px.numpy().astype(np.float64))[0]
    np.testing.assert_allclose(geometry.project_points(to_px, tf.constant(points)), expected, atol=1e-2)


@FAST
@given(tilt=st.floats(0, 20), direction=ANGLES, roll=ANGLES)
def test_sheet_coordinates_invert_the_projection(tilt: float, direction: float, roll: float) -> None:
    to_px = tilted_view(tilt, direction, roll).to_px
    x, y = geometry.pixel_centres_to_sheet(to_px, (30, 40))
    back = geometry.project_points(to_px, tf.stack([x, y], axis=-1)).numpy()
    expected = np.stack(np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5), -1)
    np.testing.assert_allclose(back, expected, atol=0.02)


@FAST
@given(tilt=st.floats(0, 20), direction=ANGLES, x=st.floats(-60, 60), y=st.floats(-60, 60))
def test_scale_is_the_root_of_the_jacobian(tilt: float, direction: float, x: float, y: float) -> None:
    to_px = tilted_view(tilt, direction, 0.3).to_px
    matrix = to_px.numpy().astype(np.float64)
    steps = np.array([[x + 1e-3, y], [x - 1e-3, y], [x, y + 1e-3], [x, y - 1e-3]])
    right, left, below, above = cv2.perspectiveTransform(steps[None], matrix)[0]
    numeric = np.linalg.det(np.stack([right - left, below - above])) / 4e-6
    found = float(geometry.px_per_mm_at(to_px, tf.constant([x, y], tf.float32)))
    assert found == pytest.approx(math.sqrt(abs(numeric)), rel=1e-3)


def test_homography_is_a_pinhole_over_a_tilted_sheet() -> None:
    tilt, direction, roll, distance, scale = 0.3, 0.7, -1.1, 140.0, 3.5
    found = pinhole_homography(*(tf.constant(number) for number in (tilt, direction, roll, distance, scale)))
    points = np.random.default_rng(1).uniform(-50, 50, (20, 2))
    axis = np.array([math.cos(direction), math.sin(direction), 0])
    turn, _ = cv2.Rodrigues(axis * tilt)
    space = np.pad(points, [(0, 0), (0, 1)]) @ turn.T + [0, 0, distance]
    seen_at = scale * distance * space[:, :2] / space[:, 2:]
    rolled = np.array([[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]])
    projected = geometry.project_points(found, tf.constant(points, tf.float32))
    np.testing.assert_allclose(projected, seen_at @ rolled.T, atol=1e-2)


@FAST
@given(tilt=st.floats(0, 20), direction=ANGLES, height=st.floats(0, 5))
def test_what_is_above_the_sheet_is_magnified_about_the_foot(
    tilt: float, direction: float, height: float
) -> None:
    view = tilted_view(tilt, direction, 0.0)
    distance = float(view.height_mm) / math.cos(math.radians(tilt))
    points = np.random.default_rng(2).uniform(-40, 40, (20, 2))
    turn, _ = cv2.Rodrigues(math.radians(tilt) * np.array([math.cos(direction), math.sin(direction), 0]))

    def to_photo(height: float) -> np.ndarray:
        in_space = np.column_stack([points, np.full(len(points), -height)]) @ turn.T + [0, 0, distance]
        return 400 / float(view.fov_mm) * distance * in_space[:, :2] / in_space[:, 2:]

    magnified = view.foot + view.magnification_at(tf.constant(height)) * (points - view.foot)
    moved = view.to_photo(magnified) - view.to_photo(tf.constant(points, tf.float32))
    np.testing.assert_allclose(moved, to_photo(height) - to_photo(0.0), atol=0.02)


@FAST
@given(
    fill=st.floats(0.25, 0.86), place=st.floats(0, 1), roll=ANGLES, tilt=st.floats(0, 20), direction=ANGLES
)
def test_leaf_keeps_off_the_frame(
    fill: float, place: float, roll: float, tilt: float, direction: float
) -> None:
    view = view_of(
        (200, 300), fill=fill, place_x=place, place_y=1 - place, roll=roll, tilted=True, tilt_deg=tilt,
        tilt_direction=direction,
    )  # fmt: skip
    corners = geometry.project_points(view.to_px, tf.constant(BOX)).numpy()
    edge = IMAGE_BORDER * np.array([300, 200])
    assert (corners >= edge - 0.05).all() and (corners <= [300, 200] - edge + 0.05).all()


def test_place_moves_the_leaf_from_border_to_border() -> None:
    for place, expected in ((0.0, 8.0), (1.0, 392.0)):
        view = view_of(place_x=place, roll=0.0, tilted=False)
        corners = geometry.project_points(view.to_px, tf.constant(BOX)).numpy()[:, 0]
        assert (corners.min() if place == 0 else corners.max()) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize(("fill", "width"), [(0.34, 230), (0.5, 200), (0.86, 100 / 0.86)])
def test_field_of_view_within_its_limits(fill: float, width: float) -> None:
    view = view_of(fill=fill, roll=0.0, tilted=False, tilt_deg=15.0)
    assert float(view.fov_mm) == pytest.approx(width, rel=1e-4)
    assert 400 / float(view.px_per_mm) == pytest.approx(width, rel=1e-4)


@pytest.mark.parametrize("sigma", [0.4, 1.0, 2.0])
def test_blur_equals_opencv(sigma: float) -> None:
    image = random_image()
    kernel = cv2.getGaussianKernel(13, sigma)
    expected = [cv2.sepFilter2D(c, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE) for c in image]
    found = filters.gaussian_blur(tf.constant(image), tf.constant(sigma), 6)
    np.testing.assert_allclose(found, np.stack(expected), atol=1e-3)


def test_focus_blurs_by_millimetres() -> None:
    image = tf.constant(random_image(size=(224, 224)))
    soft = imaging.apply_focus_blur(
        image, middle(CameraParams(), blurred=True, blur_mm=0.1), tf.constant(3.5), 70.0
    )
    np.testing.assert_allclose(soft, filters.gaussian_blur(image, tf.constant(0.35), 4), atol=1e-3)


def test_widest_blur_fits_its_taps() -> None:
    # At the closest view the widest blur is 0.25 mm * 224 / 70 px = 0.8 px.
    image = tf.constant(random_image(size=(224, 224)))
    widest = imaging.apply_focus_blur(
        image, middle(CameraParams(), blurred=True, blur_mm=0.25), tf.constant(224 / 70), 70.0
    )
    np.testing.assert_allclose(widest, filters.gaussian_blur(image, tf.constant(0.8), 8), atol=0.06)


def test_neutral_white_balance_and_tone_change_nothing() -> None:
    neutral = middle(CameraParams(), warmth=0.0, green=0.0, exposure=1.0, contrast=1.0, saturation=1.0)
    white = tf.ones([3, 1, 1])
    np.testing.assert_allclose(
        imaging.apply_white_balance_and_tone(tf.constant(random_image()), neutral, white),
        random_image(),
        atol=1e-5,
    )


def test_white_balance_and_tone_follow_their_parameters() -> None:
    numbers = {"warmth": 0.2, "green": 0.05, "exposure": 0.9, "contrast": 1.1, "saturation": 0.8}
    image = random_image()
    paper = np.array([0.6, 0.8, 0.7], np.float32)[:, None, None]
    # The brightest channel of bare paper after balancing is green, and lands at 0.9.
    balanced = image * np.array([1.1, 1.05, 0.9])[:, None, None] * (0.9 / (0.8 * 1.05))
    grey = np.tensordot(LUMA, balanced, 1)
    expected = ((grey + 0.8 * (balanced - grey)) - 0.5) * 1.1 + 0.5
    # Contrast turns about mid-grey before or after the gains alike: it is the last of the affine maps.
    found = imaging.apply_white_balance_and_tone(
        tf.constant(image), middle(CameraParams(), **numbers), tf.constant(paper)
    )
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_sensor_noise_has_its_strength_and_is_stronger_in_the_shadows() -> None:
    image = np.zeros((3, 100, 100), np.float32)
    image[:, 50:] = 0.9
    noise = recording.cut_sensor_noise(tf.constant([0.2, 0.6]), (100, 100))
    silent = recording.add_sensor_noise(tf.constant(image), middle(CameraParams(), noise=0.0), noise)
    np.testing.assert_array_equal(silent, image)
    noisy = (
        recording.add_sensor_noise(tf.constant(image), middle(CameraParams(), noise=0.04), noise).numpy()
        - image
    )
    assert noisy[:, :50].std() == pytest.approx(0.04 * 1.25, rel=0.05)
    assert noisy[:, 50:].std() == pytest.approx(0.04 * (1.25 - 0.54), rel=0.05)


def soften_chroma(image: np.ndarray) -> tf.Tensor:
    return recording.restore_chroma(tf.constant(image), recording.halve_chroma(tf.constant(image)))


def test_chroma_softness_leaves_luma_alone() -> None:
    image = random_image(size=(41, 50))
    soft = soften_chroma(image).numpy()
    np.testing.assert_allclose(np.tensordot(LUMA, soft, 1), np.tensordot(LUMA, image, 1), atol=1e-5)
    chroma, before = (x[0] - np.tensordot(LUMA, x, 1) for x in (soft, image))
    assert np.abs(np.diff(chroma)).mean() < 0.6 * np.abs(np.diff(before)).mean()


@pytest.mark.parametrize("size", [(40, 50), (41, 33)])
def test_chroma_is_halved_and_doubled_as_resizing_does(size: tuple[int, int]) -> None:
    image = random_image(size=size)
    chroma = image - np.tensordot(LUMA.astype(np.float32), image, 1)
    even = np.pad(chroma, [(0, 0), (0, size[0] % 2), (0, size[1] % 2)], mode="edge")
    halved = even.reshape(3, even.shape[1] // 2, 2, even.shape[2] // 2, 2).mean(axis=(2, 4))
    doubled = [cv2.resize(c, even.shape[:0:-1], interpolation=cv2.INTER_LINEAR) for c in halved]
    expected = image - chroma + np.stack(doubled)[:, : size[0], : size[1]]
    np.testing.assert_allclose(soften_chroma(image), expected, atol=1e-5)
