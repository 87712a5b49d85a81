"""Noise fields against independent references."""

import itertools

import numpy as np
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.camera import recording

SIZES = st.tuples(st.integers(1, 40), st.integers(1, 40))


def make_grid(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, shape).astype(np.float32)


def pixel_positions(size: tuple[int, int], cells: float) -> np.ndarray:
    """Grid coordinates [2, H, W] (row, column) of pixel centres."""
    return (np.indices(size) + 0.5) * cells / max(size)


def perlin(gradients: np.ndarray, row: float, column: float) -> float:
    """Perlin's sum over the four corners around one point."""
    total = 0.0
    for i, j in itertools.product((int(row), int(row) + 1), (int(column), int(column) + 1)):
        down, across = row - i, column - j
        fade = [(lambda t: ((6 * t - 15) * t + 10) * t**3)(1 - abs(d)) for d in (down, across)]
        total += fade[0] * fade[1] * (gradients[0, i, j] * across + gradients[1, i, j] * down)
    return total


def test_gradient_noise_is_zero_at_the_nodes() -> None:
    gradients = make_grid(2, 20, 20)
    at_nodes = noise.gradient_noise(gradients, (9, 9), cells=18.0).values.numpy()
    between = noise.gradient_noise(gradients, (9, 9), cells=17.0).values.numpy()
    assert np.abs(at_nodes).max() < 1e-5 and np.abs(between).max() > 0.1


@settings(max_examples=20, deadline=None)
@given(size=SIZES, cells=st.floats(0.5, 7.0), seed=st.integers(0, 99))
def test_gradient_noise_is_perlins(size: tuple[int, int], cells: float, seed: int) -> None:
    gradients = make_grid(2, 9, 9, seed=seed)
    expected = np.vectorize(lambda row, column: perlin(gradients, row, column))(*pixel_positions(size, cells))
    found = noise.gradient_noise(gradients, size, cells=cells).values.numpy()
    np.testing.assert_allclose(found, 1.4 * expected, atol=1e-4)


@settings(max_examples=20, deadline=None)
@given(size=SIZES, cells=st.floats(0.5, 7.0), seed=st.integers(0, 99))
def test_interpolation_is_the_cubic_b_spline(size: tuple[int, int], cells: float, seed: int) -> None:
    values = make_grid(10, 10, seed=seed)
    expected = ndimage.map_coordinates(values, pixel_positions(size, cells) + 1, order=3, prefilter=False)
    np.testing.assert_allclose(noise.interpolate_grid(values, size, cells=cells).values, expected, atol=1e-5)


def test_interpolation_keeps_a_constant_up_to_the_border() -> None:
    np.testing.assert_allclose(noise.interpolate_grid(tf.ones([8, 8]), (30, 50)).values, 1, atol=1e-5)


def test_simple_noise_is_centred_and_about_unit_range() -> None:
    uniform = np.random.default_rng(1).uniform(size=(40, 40)).astype(np.float32)
    field = noise.simple_noise(uniform, (200, 200)).values.numpy()
    assert abs(field.mean()) < 0.05 and 0.8 < np.abs(field).max() <= 2


def test_voronoi_distances_are_those_of_a_search_through_all_points() -> None:
    for seed in range(5):
        jitter = np.random.default_rng(seed).uniform(size=(2, 10, 10)).astype(np.float32)
        points = (jitter + np.indices((10, 10)) - 1).reshape(2, -1)
        found = noise.voronoi_distance_grid(tf.constant(jitter)).numpy()
        places = (np.indices(found.shape) + 0.5) * 8 / len(found)
        distances = np.linalg.norm(places[:, :, :, None] - points[:, None, None, :], axis=0)
        # The search looks at nine cells: a point two cells away may be nearer where the nine are far.
        np.testing.assert_allclose(found, distances.min(axis=-1), atol=2e-2)
        assert np.mean(np.abs(found - distances.min(axis=-1)) > 1e-5) < 0.01


def test_voronoi_noise_is_centred() -> None:
    jitter = np.random.default_rng(3).uniform(size=(2, 10, 10)).astype(np.float32)
    field = noise.voronoi_noise(tf.constant(jitter), (120, 120)).values.numpy()
    assert abs(field.mean()) < 0.15 and field.min() > -1 and field.max() < 1.3


def test_blend_is_the_papers_weighted_sum() -> None:
    pairs = [(make_grid(4, k, seed=k), make_grid(5, k, seed=9 + k)) for k in (2, 3, 6)]
    fields = tuple(noise.SeparableField(tf.constant(down), tf.constant(across)) for down, across in pairs)
    blended = noise.blend_noises((0.2, 0.3, 0.5), fields).values.numpy()
    expected = sum(w * down @ across.T for w, (down, across) in zip((0.2, 0.3, 0.5), pairs, strict=True))
    np.testing.assert_allclose(blended, expected, atol=1e-6)


def test_sensor_noise_is_white_and_of_unit_variance() -> None:
    cut, other = (
        recording.cut_sensor_noise(tf.constant([down, 0.7]), (128, 96)).numpy() for down in (0.3, 0.31)
    )
    assert cut.shape == (3, 128, 96)
    np.testing.assert_allclose(cut.std(axis=(1, 2)), 1, atol=0.03)
    for neighbour in (cut[:, 1:], cut[:, :, 1:]):
        rows, columns = neighbour.shape[1:]
        assert abs(np.mean(cut[:, :rows, :columns] * neighbour)) < 0.03
    assert np.abs(cut - other).max() > 1
