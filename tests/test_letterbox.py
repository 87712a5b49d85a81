"""Photos of any shape in networks of fixed shape, and masks back on photos."""

import numpy as np
import pytest
import tensorflow as tf
from green import PAPER, disk, photo

from laesi_tf.data.letterbox import compute_letterbox, letterbox_image, letterbox_mask


def test_photo_of_the_inputs_size_is_unchanged() -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 48, 3), np.uint8)
    assert np.array_equal(letterbox_image(image, (64, 48))[0], image)


@pytest.mark.parametrize("size", [(60, 80), (75, 100), (31, 42), (10, 14)])
def test_filter_is_the_antialiased_bilinear_one(size: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    small, letterbox = letterbox_image(image, (15, 20))
    (left, top), (height, width) = letterbox.origin, letterbox.extent
    reference = tf.image.resize(image, (height, width), antialias=True).numpy()
    assert np.abs(small[top : top + height, left : left + width] - reference).max() <= 1.5


@pytest.mark.parametrize("size", [(300, 300), (200, 400), (400, 200), (333, 517), (30, 20)])
@pytest.mark.parametrize("target", [(64, 64), (96, 64)])
def test_pixels_stay_square_and_nothing_is_cropped(size: tuple[int, int], target: tuple[int, int]) -> None:
    letterbox = compute_letterbox(size, target)
    x, y = letterbox.scale
    assert x == pytest.approx(y, rel=0.51 / min(letterbox.extent))
    start, end = np.array(letterbox.origin), letterbox.origin + letterbox.extent.xy
    assert (start >= 0).all() and (end <= letterbox.input_size.xy).all()
    assert letterbox.extent[0] == target[0] or letterbox.extent[1] == target[1]


def test_fill_is_the_colour_along_the_border() -> None:
    image, letterbox = letterbox_image(photo(100, 200), (64, 64))
    assert letterbox.origin == (0, 16)
    assert (image[:16] == PAPER).all() and (image[48:] == PAPER).all()


@pytest.mark.parametrize("size", [(300, 300), (200, 400), (411, 200)])
def test_mask_there_and_back(size: tuple[int, int]) -> None:
    true = disk(*size)
    small = letterbox_mask(true, (96, 96))
    letterbox = compute_letterbox(size, (96, 96))
    assert small.sum() / np.prod(letterbox.scale) == pytest.approx(true.sum(), rel=0.03)
    back = letterbox.crop_and_resize_back(small) >= 0.5
    assert back.shape == size and (back & true).sum() / (back | true).sum() > 0.94


def test_points_there_and_back() -> None:
    letterbox = compute_letterbox((300, 500), (96, 96))
    corners = np.array([[0, 0], [500, 300]])
    assert letterbox.to_input_points(corners) == pytest.approx(np.array([[0, 19], [96, 77]]))
    assert letterbox.to_photo_points(letterbox.to_input_points(corners)) == pytest.approx(corners)


def test_mask_comes_back_to_its_place() -> None:
    true = np.zeros((300, 500), bool)
    true[40:120, 330:430] = True
    back = compute_letterbox((300, 500), (96, 96)).crop_and_resize_back(letterbox_mask(true, (96, 96))) >= 0.5
    for found, expected in zip(np.nonzero(back), np.nonzero(true), strict=True):
        assert found.mean() == pytest.approx(expected.mean(), abs=1.5)


@pytest.mark.parametrize("size", [(1, 1), (1, 5000), (40000, 3)])
def test_extreme_shapes(size: tuple[int, int]) -> None:
    image, letterbox = letterbox_image(np.full((*size, 3), 77, np.uint8), (64, 64))
    assert image.shape == (64, 64, 3) and (image == 77).all()
    assert letterbox.crop_and_resize_back(np.ones((64, 64))).shape == size
