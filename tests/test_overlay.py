"""Drawings on photos: outlines, grid, labels, captions."""

import numpy as np
import pytest

from laesi_tf.estimators.base import LeafMeasurement, Measurement
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera
from laesi_tf.reporting.captions import add_caption, make_contact_sheet
from laesi_tf.reporting.measurement_overlay import describe_measurement
from laesi_tf.reporting.overlay import GRID_COLOUR, draw_grid, draw_outlines


def test_outline_is_drawn_where_the_leaf_is() -> None:
    image = np.zeros((300, 400, 3), np.uint8)
    square = np.array([[100.0, 100.0], [300.0, 100.0], [300.0, 200.0], [100.0, 200.0]])
    drawn = draw_outlines(image, [(square, (255, 0, 160))])
    rows, columns = np.nonzero(drawn[..., 0] > 100)
    # A line one pixel wide on the border between two pixels covers both.
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == pytest.approx(
        (99.5, 199.5, 99.5, 299.5), abs=1
    )
    assert not image.any()


def test_caption_is_readable_and_hides_nothing() -> None:
    image = np.full((300, 400, 3), 90, np.uint8)
    framed = add_caption(image, ["31.25 cm²", "a long name " * 20])
    assert np.array_equal(framed[:300], image)
    assert framed.shape[0] > 330 and (framed[300:] < 128).any(axis=2).sum() > 100
    assert (framed[300:, -3:] == 255).all(), "the long line runs out of the picture"


def test_contact_sheet_holds_images_of_any_size() -> None:
    pictures = [np.full((height, 50, 3), shade, np.uint8) for height, shade in [(40, 10), (60, 20), (50, 30)]]
    page = make_contact_sheet(pictures, columns=2, gap=5)
    assert page.shape == (2 * 65 + 5, 2 * 55 + 5, 3)
    assert [(page == picture[0, 0]).all(axis=2).sum() for picture in pictures] == [2000, 3000, 2500]


def test_the_grid_lies_on_every_tenth_line() -> None:
    parameters = np.zeros(14)
    # Lines 8 and 10 px apart across and down, turned by 0.2; a lens that bends them.
    c, s = 300 * np.cos(0.2), 300 * np.sin(0.2)
    parameters[:9] = [0.3, -0.4, c / 8, s / 8, -s / 10, c / 10, 0.05, 0.02, 0.03]
    camera = SheetCamera(parameters, np.zeros((14, 14)), (600, 600), step=(2.0, 2.0), pitch_mm=2.0)
    plain = np.full((600, 600, 3), 255, np.uint8)
    grid = draw_grid(plain, camera, scale=0.5)[..., 0] < 100
    assert GRID_COLOUR[0] == 0
    rows, columns = np.nonzero(grid)
    sheet = camera.to_sheet(np.stack([columns + 0.5, rows + 0.5], 1) / 0.5)
    off_px = np.abs((sheet + 10) % 20 - 10) / 2 * [8, 10]
    assert grid.any() and off_px.min(axis=1).max() < 2


@pytest.mark.parametrize(("uncertainty", "text"), [(0.0, "2.00 ± 0.00 cm²"), (None, "2.00 cm²")])
def test_an_uncertainty_of_zero_is_known(uncertainty: float | None, text: str) -> None:
    leaves = (LeafMeasurement(area_cm2=2.0, uncertainty_cm2=uncertainty),)
    assert describe_measurement(Measurement(method="one", leaves=leaves)) == [text]
