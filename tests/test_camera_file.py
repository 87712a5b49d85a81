"""The file of a photo: sharpening, JPEG and resizing."""

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, middle

from laesi_tf.synthesis import load_ranges
from laesi_tf.synthesis.camera.file import compress, sharpen
from laesi_tf.synthesis.camera.params import CameraParams

SIZE = (96, 96)
COMPONENTS = ("resizing", "jpeg")


def photo() -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, 6, (*SIZE, 1))
    return (
        np.clip(np.linspace(150, 200, SIZE[1])[None, :, None] + noise, 0, 255).repeat(3, -1).astype(np.uint8)
    )


def compressed(**given: float | bool) -> np.ndarray:
    return compress(tf.constant(photo()), middle(CameraParams(), **given), COMPONENTS).numpy()


def step_at_blocks(image: np.ndarray) -> float:
    """Return the mean step between columns at the borders of 8 px blocks over that elsewhere."""
    steps = np.abs(np.diff(image[..., 1].astype(float), axis=1)).mean(axis=0)
    at_border = np.arange(1, SIZE[1]) % 8 == 0
    return steps[at_border].mean() / steps[~at_border].mean()


def test_jpeg_leaves_blocks_the_more_the_lower_its_quality() -> None:
    assert step_at_blocks(photo()) == pytest.approx(1, abs=0.15)
    errors = []
    for quality in (25.0, 60.0, 98.0):
        image = compressed(is_jpeg=True, jpeg_quality=quality)
        errors.append(np.abs(image.astype(int) - photo()).mean())
    assert errors[0] > errors[1] > errors[2] > 0
    assert step_at_blocks(compressed(is_jpeg=True, jpeg_quality=25.0)) > 1.5


def test_blocks_of_a_larger_file_shrink_with_it() -> None:
    larger = compressed(is_jpeg=True, jpeg_quality=25.0, resized=True, resize_factor=1.5)
    assert larger.shape == (*SIZE, 3)
    assert step_at_blocks(larger) < step_at_blocks(compressed(is_jpeg=True, jpeg_quality=25.0))


def test_a_smaller_file_loses_detail() -> None:
    small = compressed(resized=True, resize_factor=0.5)
    assert small.shape == (*SIZE, 3)
    assert np.diff(small[..., 1].astype(float)).std() < 0.6 * np.diff(photo()[..., 1].astype(float)).std()


def test_neither_leaves_the_photo() -> None:
    np.testing.assert_array_equal(compressed(), photo())


def test_sharpening_overshoots_beside_an_edge_and_keeps_plains() -> None:
    image = np.full((3, *SIZE), 0.3, np.float32)
    image[:, :, 48:] = 0.6
    params = middle(CameraParams(), sharpening=1.0, sharpening_px=1.0)
    sharp = sharpen(tf.constant(image), params).numpy()
    assert sharp.max() > 0.65 and sharp.min() < 0.25
    np.testing.assert_allclose(sharp[:, :, [0, 20, 80, 95]], image[:, :, [0, 20, 80, 95]], atol=1e-3)


def test_only_phone_has_files() -> None:
    names = ("sharpening", "resizing", "jpeg")
    assert not any(RENDERING_2.has(name) for name in names)
    assert all(load_ranges("phone").has(name) for name in names)
