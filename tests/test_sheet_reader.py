"""The shipped ruling network and the fit together, on drawn sheets of known geometry."""

import numpy as np
import pytest
from drawn_sheets import View, draw_photo

from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling.judge import SheetReading
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.models.saved_model import PRETRAINED, load_run

MILLIMETRES = {1.0: 0.55, 5.0: 0.8, 10.0: 1.0}


@pytest.fixture(scope="module")
def reader() -> SheetReader:
    return SheetReader(load_run(PRETRAINED / "ruling").model)


def read(reader: SheetReader, photo: np.ndarray) -> SheetReading:
    return reader.read(PhotoPyramid(photo.astype(np.uint8)).overview, grid_mm=None)


def test_the_scale_of_millimetre_paper(reader: SheetReader) -> None:
    view = View(height=720, width=960, px_per_mm=7.0, tilt=(0.15, -0.1))
    reading = read(reader, draw_photo(view, MILLIMETRES))
    assert reading.camera is not None, reading.refusal
    middle = np.array([480.0, 360.0])
    expected = 1 / np.sqrt(view.density(middle[None])[0])
    assert reading.camera.px_per_mm(middle) == pytest.approx(expected, rel=2e-3)
    assert reading.outline is not None and np.ptp(reading.outline, axis=0).min() > 500


def test_paper_without_lines_is_refused(reader: SheetReader) -> None:
    plain = draw_photo(View(height=720, width=960), {1.0: 0.0}, quality=40)
    reading = read(reader, plain)
    assert reading.camera is None and reading.refusal is not None
