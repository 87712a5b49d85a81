"""The whole measurement as one file: converted once, with a stand-in for the mask network."""

from pathlib import Path

import numpy as np
import pytest
from drawn_sheets import View, draw_photo
from estimator_conformance import EstimatorConformance
from green import LEAF, disk, mask_network, photo
from litert_files import SIZE
from test_ruling_estimator import MILLIMETRES, draw_disk

from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.estimators.keras_networks import make_mask_estimator
from laesi_tf.estimators.litert_estimator import LiteRtEstimator
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.ruling_estimator import RulingEstimator


@pytest.fixture(scope="module")
def litert(photo_file: Path) -> Estimator:
    # The weights of the ruling network are in it.
    assert photo_file.stat().st_size > 4 * 0.47e6
    estimator = load_estimator(photo_file)
    assert isinstance(estimator, LiteRtEstimator)
    return estimator


@pytest.fixture(scope="module")
def ruling_estimator(sheet_reader: SheetReader) -> RulingEstimator:
    return RulingEstimator(make_mask_estimator(mask_network(SIZE), SIZE), sheet_reader)


class TestLiteRtEstimator(EstimatorConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def estimator(cls, litert: Estimator) -> Estimator:
        return litert


VIEWS = (View(600, 800, tilt=(0.15, -0.1)), View(800, 600, k1=0.03), View(480, 1600, px_per_mm=9))


@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_it_measures_as_the_ruling_estimator(
    litert: Estimator, ruling_estimator: RulingEstimator, view: View
) -> None:
    image, true_cm2 = draw_disk(view)
    measured, expected = litert.measure(image), ruling_estimator.measure(image)
    assert measured.refusal is None and measured.area_cm2 == pytest.approx(true_cm2, rel=0.02)
    assert measured.tilt_deg == pytest.approx(expected.tilt_deg, abs=0.3)
    (leaf,), (other,) = measured.leaves, expected.leaves
    assert leaf.px_per_mm == pytest.approx(other.px_per_mm, rel=2e-3)
    assert (leaf.length_mm, leaf.width_mm) == pytest.approx((other.length_mm, other.width_mm), rel=0.03)
    assert leaf.uncertainty_cm2 is not None and 0.001 * true_cm2 < leaf.uncertainty_cm2 < 0.05 * true_cm2
    assert measured.mask is not None and expected.mask is not None
    assert (measured.mask & expected.mask).sum() / (measured.mask | expected.mask).sum() > 0.97
    assert measured.camera is not None and expected.camera is not None
    corners = np.array([[100.0, 100.0], [view.width - 100.0, view.height - 100.0]])
    lines = measured.camera.to_sheet(corners) - expected.camera.to_sheet(corners)
    np.testing.assert_allclose(lines, np.round(lines), atol=0.1)


def test_refusals_are_the_same(litert: Estimator, ruling_estimator: RulingEstimator) -> None:
    fives, _ = draw_disk(View(600, 800), levels={5.0: 0.8})
    millimetres, _ = draw_disk(View(600, 800))
    blank = np.full((200, 200, 3), 240, np.uint8)
    paper = draw_photo(View(600, 800), MILLIMETRES).astype(np.uint8)
    cases = [(fives, None), (millimetres, 5.0), (photo(400, 400), None), (blank, None), (paper, None)]
    for image, grid_mm in cases:
        info = PhotoInfo(grid_mm=grid_mm)
        refused, expected = litert.measure(image, info).refusal, ruling_estimator.measure(image, info).refusal
        assert refused is not None and expected is not None
        # Distances are given to a tenth of a pixel.
        assert refused[:40] == expected[:40]


def test_the_pitch_can_be_named_and_so_can_the_scale(
    litert: Estimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    fives, true_cm2 = draw_disk(View(600, 800), levels={5.0: 0.8})
    assert litert.measure(fives, PhotoInfo(grid_mm=5.0)).area_cm2 == pytest.approx(true_cm2, rel=0.02)
    # A printer that shrinks to 97 % leaves the lines of the sheet 0.97 mm apart.
    image, true_cm2 = draw_disk(View(600, 800))
    shrunk_print = litert.measure(image, PhotoInfo(grid_mm=0.97))
    assert shrunk_print.area_cm2 == pytest.approx(0.97**2 * true_cm2, rel=0.02)
    # As `load_estimator(FILE, has_known_scale=True)` would, without half a gigabyte for a second interpreter.
    monkeypatch.setattr(litert, "_reads_ruling", False)
    image = photo(1300, 1700)
    expected = disk(1300, 1700).sum() / 12.0**2 / 100
    measured = litert.measure(image, PhotoInfo(px_per_mm=12.0))
    assert measured.method == "LiteRT: silhouette x given scale"
    assert measured.area_cm2 == pytest.approx(expected, rel=0.01)
    assert measured.leaves[0].px_per_mm == pytest.approx(12.0, rel=1e-3)


def test_two_leaves_and_one_beside_the_sheet(litert: Estimator) -> None:
    view = View(600, 900, px_per_mm=6.0, turn=0.0)
    image = draw_photo(view, MILLIMETRES).astype(np.uint8)
    y, x = np.mgrid[:600, :900]
    for middle in (150, 400):
        image[((x - middle) / 60) ** 2 + ((y - 300) / 110) ** 2 < 1] = LEAF
    image[:, 560:] = (120, 90, 70)
    image[((x - 740) / 60) ** 2 + ((y - 300) / 110) ** 2 < 1] = LEAF
    measured = litert.measure(image)
    assert measured.refusal is None, measured.refusal
    assert [leaf.area_cm2 for leaf in measured.leaves] == pytest.approx(
        [np.pi * 60 * 110 / 3600] * 2, rel=0.02
    )
    assert measured.note is not None and "not counted: 1" in measured.note


def test_a_leaf_that_the_border_cuts_off_has_a_note(litert: Estimator) -> None:
    image, _ = draw_disk(View(600, 800))
    (leaf,) = litert.measure(image[:, 370:]).leaves
    assert leaf.note is not None and "cut off" in leaf.note
