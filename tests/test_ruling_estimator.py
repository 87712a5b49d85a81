"""The ruling estimator: the shipped reader of rulings with stand-ins for the other networks."""

import cv2
import numpy as np
import pytest
from drawn_sheets import View, draw_photo
from estimator_conformance import EstimatorConformance
from green import LEAF, area_network, disk, mask_network, photo

from laesi_tf.estimators.area_estimator import AreaEstimator, AreaPrediction
from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.estimators.keras_networks import make_area_estimator, make_mask_estimator
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.ruling_estimator import MOSTLY_UNCOUNTED, NO_LEAF_ON_SHEET, RulingEstimator

SIZE = (96, 96)
MILLIMETRES = {1.0: 0.55, 5.0: 0.8, 10.0: 1.0}


@pytest.fixture(scope="module")
def guesser() -> AreaEstimator:
    return make_area_estimator(area_network(SIZE), SIZE, "none")


@pytest.fixture(scope="module")
def ruling_estimator(sheet_reader: SheetReader) -> RulingEstimator:
    return RulingEstimator(make_mask_estimator(mask_network(SIZE), SIZE), sheet_reader)


@pytest.fixture(scope="module")
def guessing(sheet_reader: SheetReader, guesser: AreaEstimator) -> RulingEstimator:
    return RulingEstimator(make_mask_estimator(mask_network(SIZE), SIZE), sheet_reader, guesser=guesser)


class TestRulingEstimator(EstimatorConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def estimator(cls, guessing: RulingEstimator) -> Estimator:
        return guessing


def draw_disk(view: View, *, levels: dict[float, float] = MILLIMETRES) -> tuple[np.ndarray, float]:
    """A photo of a green disk on a ruled sheet, and the disk's area in cm2."""
    image = draw_photo(view, levels).astype(np.uint8)
    leaf = disk(view.height, view.width, radius=0.2)
    image[leaf] = LEAF
    points = np.argwhere(leaf)[:, ::-1] + 0.5
    return image, view.density(points).sum() / 100


@pytest.mark.parametrize("view", [View(600, 800, tilt=(0.15, -0.1)), View(600, 800, k1=0.03)], ids=str)
def test_a_disk_is_measured_through_tilt_and_lens(ruling_estimator: RulingEstimator, view: View) -> None:
    image, true_cm2 = draw_disk(view)
    measured = ruling_estimator.measure(image)
    assert measured.refusal is None and measured.method == "ruling x silhouette"
    assert measured.area_cm2 == pytest.approx(true_cm2, rel=0.02)
    (found,) = measured.leaves
    assert (found.length_mm, found.width_mm) == pytest.approx((48, 48), rel=0.06)
    assert measured.tilt_deg is not None and measured.camera is not None
    assert found.uncertainty_cm2 is not None
    assert 0.001 * true_cm2 < found.uncertainty_cm2 < 0.05 * true_cm2


def test_the_pitch_of_other_paper_is_asked_for(ruling_estimator: RulingEstimator) -> None:
    image, true_cm2 = draw_disk(View(600, 800), levels={5.0: 0.8})
    unknown = ruling_estimator.measure(image)
    assert unknown.refusal is not None and "--grid-mm" in unknown.refusal
    named = ruling_estimator.measure(image, PhotoInfo(grid_mm=5.0))
    assert named.area_cm2 == pytest.approx(true_cm2, rel=0.02)


def test_without_a_ruling_the_photo_is_refused(
    ruling_estimator: RulingEstimator, guessing: RulingEstimator, guesser: AreaEstimator
) -> None:
    plain = photo(400, 400)
    refused = ruling_estimator.measure(plain)
    assert refused.refusal is not None and "no ruling" in refused.refusal
    assert refused.mask is not None and refused.leaves[0].outline is not None
    guessed = guessing.measure(plain)
    assert guessed.method == "regression, no ruling read"
    assert guessed.note is not None and "no ruling" in guessed.note
    assert guessed.area_cm2 == guesser.measure(plain).area_cm2
    assert guessed.uncertainty_cm2 is not None and guessed.area_cm2 is not None
    assert guessed.uncertainty_cm2 > 0.1 * guessed.area_cm2


def test_several_leaves_are_guessed_by_the_scale(sheet_reader: SheetReader, guesser: AreaEstimator) -> None:
    mask_estimator = make_mask_estimator(mask_network(SIZE), SIZE)
    two = np.concatenate([photo(300, 300)] * 2, axis=1)
    refused = RulingEstimator(mask_estimator, sheet_reader, guesser=guesser).measure(two)
    assert refused.refusal is not None and "no scale" in refused.refusal
    with_scale = WithScale(lambda _: (1.0, 5.0), SIZE)
    guessed = RulingEstimator(mask_estimator, sheet_reader, guesser=with_scale).measure(two)
    assert guessed.method == "silhouette x scale of the area model, no ruling read"
    expected = 2 * np.pi * 90**2 / 5.0**2 / 100
    assert guessed.area_cm2 == pytest.approx(expected, rel=0.05) and len(guessed.leaves) == 2


class WithScale(AreaEstimator):
    """An area network that is sure of five pixels per mm."""

    def predict_area(self, pyramid: PhotoPyramid) -> AreaPrediction:
        return AreaPrediction(1.0, 5.0)


def test_two_leaves_are_measured_and_notes_are_kept(ruling_estimator: RulingEstimator) -> None:
    view = View(600, 900, px_per_mm=6.0)
    image = draw_photo(view, {1.0: 0.5, 5.0: 0.9}).astype(np.uint8)
    for middle in ((250, 300), (650, 300)):
        cv2.circle(image, middle, 90, LEAF, -1)
    measured = ruling_estimator.measure(image)
    assert measured.refusal is None, measured.refusal
    areas = [leaf.area_cm2 for leaf in measured.leaves]
    assert areas == pytest.approx([np.pi * 15**2 / 100] * 2, rel=0.02)
    assert measured.note is not None and "every fifth line is heavier" in measured.note


def test_a_named_distance_that_contradicts_the_lines_is_refused(ruling_estimator: RulingEstimator) -> None:
    image, true_cm2 = draw_disk(View(600, 800))
    refused = ruling_estimator.measure(image, PhotoInfo(grid_mm=5.0))
    assert refused.refusal is not None and "grid-mm" in refused.refusal
    shrunk_print = ruling_estimator.measure(image, PhotoInfo(grid_mm=0.97))
    assert shrunk_print.area_cm2 == pytest.approx(0.97**2 * true_cm2, rel=0.02)


def test_no_leaf_is_refused(ruling_estimator: RulingEstimator) -> None:
    blank = np.full((200, 200, 3), 240, np.uint8)
    measured = ruling_estimator.measure(blank)
    assert measured.refusal is not None and "no leaf" in measured.refusal and "no ruling" in measured.refusal
    assert measured.mask is not None and not measured.mask.any()


def test_what_lies_beside_the_sheet_is_no_leaf(ruling_estimator: RulingEstimator) -> None:
    view = View(600, 900, px_per_mm=6.0, turn=0.0)
    image = draw_photo(view, MILLIMETRES).astype(np.uint8)
    image[:, 520:] = (120, 90, 70)
    for middle in ((250, 300), (720, 300)):
        cv2.circle(image, middle, 90, LEAF, -1)
    measured = ruling_estimator.measure(image)
    assert measured.refusal is None, measured.refusal
    (leaf,) = measured.leaves
    assert leaf.outline is not None and leaf.outline[:, 0].max() < 400
    assert measured.note is not None and "not counted: 1" in measured.note


def test_a_leaf_at_the_sheets_edge_hides_its_lines_and_counts(ruling_estimator: RulingEstimator) -> None:
    image = draw_photo(View(600, 900, px_per_mm=6.0, turn=0.0), MILLIMETRES).astype(np.uint8)
    image[:, 700:] = (120, 90, 70)
    image[:, 450:700] = 236
    for middle in ((200, 300), (570, 300)):
        cv2.circle(image, middle, 90, LEAF, -1)
    measured = ruling_estimator.measure(image)
    assert measured.refusal is None, measured.refusal
    assert len(measured.leaves) == 2


def test_lines_of_what_lies_around_a_scrap_of_paper_are_not_its_ruling(
    ruling_estimator: RulingEstimator,
) -> None:
    cloth = draw_photo(View(600, 900, px_per_mm=6.0, turn=0.0), MILLIMETRES).astype(float)
    image = (cloth * (0.55, 0.2, 0.22)).astype(np.uint8)
    image[180:430, 280:620] = (236, 232, 225)
    cv2.circle(image, (450, 300), 60, LEAF, -1)
    assert ruling_estimator.measure(image).refusal == NO_LEAF_ON_SHEET


def test_a_margin_of_the_papers_colour_is_part_of_the_leaf(ruling_estimator: RulingEstimator) -> None:
    image = draw_photo(View(600, 900, px_per_mm=6.0), MILLIMETRES).astype(np.uint8)
    cv2.circle(image, (450, 300), 120, (233, 230, 222), -1)
    cv2.circle(image, (450, 300), 90, LEAF, -1)
    measured = ruling_estimator.measure(image)
    assert measured.area_cm2 == pytest.approx(np.pi * 20**2 / 100, rel=0.06)
    assert measured.leaves[0].note is not None and "margin" in measured.leaves[0].note


def test_a_leaf_beside_much_more_of_a_leafs_colour_is_refused(ruling_estimator: RulingEstimator) -> None:
    image = draw_photo(View(600, 900, px_per_mm=6.0), MILLIMETRES).astype(np.uint8)
    cv2.circle(image, (200, 300), 35, LEAF, -1)
    turns = np.linspace(0, 2 * np.pi, 100)
    across, down = 150 * np.cos(turns), 90 * np.sin(turns) * np.cos(turns / 2) ** 2
    brown = np.round(np.stack([580 + across, 300 + down], 1)).astype(np.int32)
    cv2.fillPoly(image, [brown], (120, 80, 40))
    measured = ruling_estimator.measure(image)
    assert measured.refusal is not None and measured.refusal.startswith(MOSTLY_UNCOUNTED[:50])
    assert measured.area_cm2 is None
