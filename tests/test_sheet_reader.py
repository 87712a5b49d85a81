"""The shipped ruling network and the fit together, on drawn sheets of known geometry."""

import cv2
import numpy as np
import pytest
from drawn_sheets import View, draw_photo

from laesi_tf.estimators.parameters import replace_parameter
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling.judge import NO_RULING, SheetReading
from laesi_tf.estimators.ruling.sheet_reader import SheetReader

MILLIMETRES = {1.0: 0.55, 5.0: 0.8, 10.0: 1.0}


def read(reader: SheetReader, photo: np.ndarray) -> SheetReading:
    return reader.read(PhotoPyramid(photo.astype(np.uint8)).overview, grid_mm=None)


def test_the_scale_of_millimetre_paper(sheet_reader: SheetReader) -> None:
    view = View(height=720, width=960, px_per_mm=7.0, tilt=(0.15, -0.1))
    reading = read(sheet_reader, draw_photo(view, MILLIMETRES))
    assert reading.camera is not None, reading.refusal
    middle = np.array([480.0, 360.0])
    expected = 1 / np.sqrt(view.density(middle[None])[0])
    assert reading.camera.px_per_mm(middle) == pytest.approx(expected, rel=2e-3)
    assert reading.outline is not None and np.ptp(reading.outline, axis=0).min() > 500


def test_paper_without_lines_is_refused(sheet_reader: SheetReader) -> None:
    plain = draw_photo(View(height=720, width=960), {1.0: 0.0}, quality=40)
    reading = read(sheet_reader, plain)
    assert reading.camera is None and reading.refusal is not None


@pytest.mark.parametrize("stretch", [1.25, 0.8])
def test_photos_that_are_stretched(sheet_reader: SheetReader, stretch: float) -> None:
    view = View(height=720, width=960, px_per_mm=9.0, turn=0.0, stretch=stretch)
    reading = read(sheet_reader, draw_photo(view, MILLIMETRES))
    assert reading.camera is not None, reading.refusal
    middle = np.array([480.0, 360.0])
    expected = 1 / np.sqrt(view.density(middle[None])[0])
    assert reading.camera.px_per_mm(middle) == pytest.approx(expected, rel=2e-3)


def test_thin_lines_are_looked_at_in_full_resolution(sheet_reader: SheetReader) -> None:
    """Averaged over two pixels, one-pixel lines 8 px apart make others appear."""
    photo = np.full((800, 640, 3), 250.0)
    for period, grey in ((8, 190), (40, 150), (80, 100)):
        photo[::period] = grey
        photo[:, ::period] = np.minimum(photo[:, ::period], grey)
    reading = read(sheet_reader, photo)
    assert reading.camera is not None, reading.refusal
    assert reading.camera.px_per_mm(np.array([320.0, 400.0])) == pytest.approx(8.0, rel=2e-3)
    assert reading.proves_millimetres


def test_a_reader_uses_the_parameters_that_it_is_given(keras_sheet_reader: SheetReader) -> None:
    photo = draw_photo(View(height=720, width=960, px_per_mm=7.0), MILLIMETRES)

    def read_with(name: str, value: float) -> SheetReading:
        changed = keras_sheet_reader.with_params(replace_parameter(keras_sheet_reader.params, name, value))
        return read(changed, photo)

    default, wavy = read(keras_sheet_reader, photo), read_with("judge.scale_error.waviness", 10.0)
    assert default.camera is not None and wavy.camera is not None
    middle = np.array([480.0, 360.0])
    assert wavy.camera.scale_error(middle) > 5 * default.camera.scale_error(middle)
    assert (default.paper, read_with("reading.levels.heavy", 1e9).paper) == ("1-5-10", "1")
    assert read_with("judge.fewest_cells", 1_000_000).refusal == NO_RULING
    assert read_with("sheet_agreement", 2.0).outline is None


def test_a_shaken_photo_is_not_read_at_half_the_scale(sheet_reader: SheetReader) -> None:
    """Motion along the sheet's diagonal takes the wave of faint millimetre lines and leaves its harmonic."""
    photo = draw_photo(View(height=720, width=960, px_per_mm=7.0, turn=0.1), {1.0: 0.2, 5.0: 0.8, 10.0: 1.0})
    path = cv2.line(np.zeros((11, 11), np.float32), (2, 2), (8, 8), 1.0)
    reading = read(sheet_reader, cv2.filter2D(photo.astype(np.float32), -1, path / path.sum()))
    assert reading.camera is not None, reading.refusal
    assert reading.camera.px_per_mm(np.array([480.0, 360.0])) == pytest.approx(7.0, rel=5e-3)
