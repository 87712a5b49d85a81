"""A second reading of the ruling, of the part of a photo around its largest leaf."""

import cv2
import numpy as np
import pytest
from drawn_sheets import View, draw_photo
from green import LEAF, mask_network

from laesi_tf.common.sheet_model import FOCAL
from laesi_tf.estimators.closer_reading import CloserReadingParams, read_around_largest
from laesi_tf.estimators.keras_networks import make_mask_estimator
from laesi_tf.estimators.mask_estimator import MaskEstimator
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid
from laesi_tf.estimators.ruling.judge import SheetReading
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.ruling_estimator import RulingEstimator

SIZE = (96, 96)
MILLIMETRES = {1.0: 0.55, 5.0: 0.8, 10.0: 1.0}
CHECKS = {1.0: 0.55, 5.0: 0.9}
VIEW = View(height=720, width=960, px_per_mm=7.0, tilt=(0.15, -0.1))


@pytest.fixture(scope="module")
def mask_estimator() -> MaskEstimator:
    return make_mask_estimator(mask_network(SIZE), SIZE)


def test_a_part_is_read_as_the_whole(sheet_reader: SheetReader) -> None:
    pyramid = PhotoPyramid(draw_photo(VIEW, MILLIMETRES).astype(np.uint8))
    box = np.array([[300.0, 150.0], [900.0, 650.0]])
    part = sheet_reader.read(pyramid.crop_around(box, min_side=1, max_side=2000), grid_mm=None)
    whole = sheet_reader.read(pyramid.overview, grid_mm=None)
    assert part.camera is not None and whole.camera is not None
    points = np.array([[350.0, 200.0], [600.0, 400.0], [850.0, 600.0]])
    np.testing.assert_allclose(part.camera.mm2_per_px(points), whole.camera.mm2_per_px(points), rtol=4e-3)
    np.testing.assert_allclose(part.camera.to_photo(part.camera.to_sheet(points)), points, atol=1e-4)
    assert part.outline is not None and part.outline.min(axis=0) == pytest.approx(box[0], abs=20)


def draw_scrap_on_cloth() -> tuple[np.ndarray, View]:
    """A disk on a scrap of millimetre paper, on cloth that is ruled in lines 15 px apart."""
    paper = View(height=900, width=1200, px_per_mm=5.0)
    cloth = draw_photo(View(height=900, width=1200, px_per_mm=15.0, turn=0.5), CHECKS)
    image = (cloth * (0.55, 0.2, 0.22)).astype(np.uint8)
    scrap = (slice(300, 700), slice(400, 900))
    image[scrap] = draw_photo(paper, MILLIMETRES).astype(np.uint8)[scrap]
    cv2.circle(image, (650, 500), 110, LEAF, -1)
    return image, paper


def test_a_scrap_on_cloth_is_measured_by_its_own_lines(
    sheet_reader: SheetReader, mask_estimator: MaskEstimator
) -> None:
    image, paper = draw_scrap_on_cloth()
    cloth = sheet_reader.read(PhotoPyramid(image).overview, grid_mm=None)
    assert cloth.camera is None or cloth.camera.px_per_mm(np.array([650.0, 500.0])) > 10
    measured = RulingEstimator(mask_estimator, sheet_reader).measure(image)
    assert measured.refusal is None, measured.refusal
    assert measured.area_cm2 == pytest.approx(np.pi * (110 / paper.px_per_mm) ** 2 / 100, rel=0.02)


class FixedReader(SheetReader):
    """Returns one reading whatever it sees, and keeps what it saw."""

    def __init__(self, reading: SheetReading) -> None:
        self.reading = reading

    def read(self, part: Crop, *, grid_mm: float | None) -> SheetReading:
        self.part = part
        return self.reading


CAMERA = SheetCamera(
    np.array([0, 0, 80, 0, 0, 80, *[0.0] * 8]), np.zeros((14, 14)), (300, 300), origin=(450.0, 250.0)
)


@pytest.mark.parametrize(
    ("before", "closer", "is_believed"),
    [("", "1-5", True), ("1", "1-5", False), ("1", "1-5-10", True), ("1-5", "1-10", False)],
)
def test_only_millimetres_contradict_lines_of_the_whole_photo(
    mask_estimator: MaskEstimator, before: str, closer: str, is_believed: bool
) -> None:
    image = np.full((900, 1200, 3), 240, np.uint8)
    cv2.circle(image, (600, 400), 80, LEAF, -1)
    cv2.circle(image, (200, 200), 40, LEAF, -1)
    pyramid = PhotoPyramid(image)
    outlines = mask_estimator.outline_leaves(mask_estimator.detect_leaves(pyramid), pyramid)
    params, seen = CloserReadingParams(), SheetReading(paper=before)

    def read(reading: SheetReading) -> tuple[SheetReading | None, FixedReader]:
        reader = FixedReader(reading)
        return read_around_largest(reader, outlines, seen, pyramid, None, params), reader

    found, reader = read(SheetReading(camera=CAMERA, paper=closer))
    middle = reader.part.to_photo(reader.part.size.xy / 2)
    side = 160 * (1 + 2 * params.margin)
    assert middle == pytest.approx((600, 400), abs=4) and reader.part.size.xy == pytest.approx(side, abs=8)
    assert (found is not None) == is_believed
    if found is not None and found.camera is not None:
        # The camera is as far away as it was from the whole photo.
        assert found.camera.focal == pytest.approx(FOCAL * 1200 / reader.part.size.xy.max())
    assert read(SheetReading(refusal="none"))[0] is None
    assert read_around_largest(reader, [], seen, pyramid, None, params) is None
