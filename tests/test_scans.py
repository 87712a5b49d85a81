"""Leaves on scans of known scale: plain backgrounds of any colour, many leaves, things that are no leaves."""

import cv2
import numpy as np
import pytest
from drawn_scans import PX_PER_MM, draw_scan, fill
from estimator_conformance import EstimatorConformance

from laesi_tf.estimators.base import UNKNOWN, Estimator, Measurement, PhotoInfo
from laesi_tf.estimators.scan import scan_estimator
from laesi_tf.estimators.scan.plain_background import fit_background
from laesi_tf.estimators.scan.scan_estimator import ScanEstimator, ScanEstimatorParams
from laesi_tf.estimators.scan.touching_leaves import TouchingLeavesParams, looks_like_several_leaves

SCALE = PhotoInfo(px_per_mm=PX_PER_MM)


class Network:
    """Stands for the mask network."""

    def measure(self, image: np.ndarray, info: PhotoInfo = UNKNOWN) -> Measurement:
        return Measurement(method="network", refusal="no leaf")


def measure(scan: np.ndarray, params: ScanEstimatorParams | None = None) -> Measurement:
    return ScanEstimator(Network, params).measure(scan, SCALE)  # type: ignore[arg-type]


class TestScanEstimator(EstimatorConformance):
    @pytest.fixture
    def estimator(self) -> Estimator:
        return ScanEstimator(Network)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("background", "cloth"),
    [
        ((245, 245, 243), 0),
        ((12, 12, 14), 0),
        ((128, 128, 128), 0),
        ((40, 70, 160), 0),
        ((215, 205, 180), 0),
        ((45, 42, 48), 6),
    ],
)
def test_plain_backgrounds_of_any_colour(background: tuple[int, int, int], cloth: float) -> None:
    scan, areas = draw_scan(background, 5, cloth=cloth)
    measured = measure(scan)
    assert "plain background" in measured.method and len(measured.leaves) == 5 and measured.note is None
    for leaf, area in zip(measured.leaves, areas, strict=True):
        assert leaf.area_cm2 == pytest.approx(area, rel=0.006)
        assert leaf.uncertainty_cm2 is not None and leaf.uncertainty_cm2 < 0.02 * area


def test_a_shadow_is_no_leaf() -> None:
    scan, areas = draw_scan((245, 245, 243), 5, shadow=0.3)
    measured = measure(scan)
    assert [leaf.area_cm2 for leaf in measured.leaves] == pytest.approx(areas, rel=0.012)


def test_hundreds_of_leaves_on_one_scan() -> None:
    scan, areas = draw_scan((245, 245, 243), 300, size_mm=(150, 140), seed=1)
    measured = measure(scan)
    assert len(measured.leaves) == 300 and min(areas) < 0.1
    assert sum(leaf.area_cm2 or 0 for leaf in measured.leaves) == pytest.approx(sum(areas), rel=0.01)


def test_a_scan_that_is_shrunk_has_the_same_areas() -> None:
    scan, areas = draw_scan((245, 245, 243), 3)
    measured = measure(scan, ScanEstimatorParams(working_px=scan.shape[0] * scan.shape[1] // 3))
    assert [leaf.area_cm2 for leaf in measured.leaves] == pytest.approx(areas, rel=0.01)


def draw_square(scan: np.ndarray, left_mm: float, colour: tuple[int, int, int], side_mm: float = 10) -> None:
    left, side = (round(length * PX_PER_MM) for length in (left_mm, side_mm))
    noise = np.random.default_rng(0).normal(0, 2, (side, side, 3))
    scan[30 : 30 + side, left : left + side] = np.clip(colour + noise, 0, 255)


def test_calibration_squares_lids_and_colour_charts_do_not_count() -> None:
    leaves, areas = draw_scan((245, 245, 243), 3, size_mm=(40, 100))
    scan = np.full((leaves.shape[0] + 300, leaves.shape[1], 3), 245, np.uint8)
    scan[300:] = leaves
    for number, colour in enumerate(
        [(15, 15, 15), (30, 60, 170), (200, 40, 40), (200, 60, 150), (90, 130, 60)]
    ):
        draw_square(scan, 3 + 14 * number, colour)
    cv2.circle(scan, (1000, 130), 90, (25, 25, 28), -1)
    cv2.circle(scan, (1000, 130), 60, (40, 40, 42), -1)
    measured = measure(scan)
    # The green square could be cut from a leaf.
    assert measured.note == scan_estimator.NOT_LEAVES.format(count=5)
    noted = [leaf for leaf in measured.leaves if leaf.note == scan_estimator.ONE_COLOUR]
    assert len(noted) == 1 and noted[0].area_cm2 == pytest.approx(1.0, rel=0.02)
    others = [leaf.area_cm2 for leaf in measured.leaves if leaf.note is None]
    assert others == pytest.approx(areas, rel=0.01)


def test_leaves_that_touch_are_noted() -> None:
    scan = np.full((590, 1060, 3), 245, np.uint8)
    for middle in ((300, 300), (745, 300)):
        cv2.ellipse(scan, middle, (225, 110), 0, 0, 360, (60, 110, 40), -1)
    measured = measure(scan)
    assert [leaf.note for leaf in measured.leaves] == [scan_estimator.TOUCHING]


def ellipse(*shapes: tuple[tuple[int, int], tuple[int, int], int]) -> np.ndarray:
    mask = np.zeros((600, 900), np.uint8)
    for middle, axes, angle in shapes:
        cv2.ellipse(mask, middle, axes, angle, 0, 360, 1, -1)
    return mask > 0


def test_single_leaves_are_not_taken_for_several() -> None:
    params = TouchingLeavesParams()
    assert looks_like_several_leaves(
        ellipse(((270, 300), (200, 90), 0), ((640, 300), (200, 100), 20)), params
    )
    assert not looks_like_several_leaves(ellipse(((450, 300), (400, 180), 0)), params)
    around = np.linspace(0, 2 * np.pi, 2000)
    lobed = (1 + 0.35 * np.cos(9 * around))[:, None] * np.stack(
        [330 * np.cos(around), 150 * np.sin(around)], 1
    )
    assert not looks_like_several_leaves(fill(lobed + np.array([450, 300]), (600, 900)) > 0.5, params)
    stalked = ellipse(((450, 300), (400, 180), 0))
    stalked[293:307, 800:] = True
    assert not looks_like_several_leaves(stalked, params)


def test_ruled_paper_and_sheets_on_a_desk_are_left_to_the_network() -> None:
    ruled, _ = draw_scan((240, 238, 230), 1)
    ruled[::12] = ruled[::12] * 0.8
    ruled[:, ::12] = ruled[:, ::12] * 0.8
    assert fit_background(ruled) is None and measure(ruled).method == "network"
    sheet, _ = draw_scan((240, 238, 230), 1)
    desk = np.full((sheet.shape[0] + 400, sheet.shape[1] + 400, 3), (60, 45, 35), np.uint8)
    desk[200:-200, 200:-200] = sheet
    assert measure(desk).method == "network"


def test_leaves_that_the_border_cuts_off_are_noted() -> None:
    scan, _ = draw_scan((245, 245, 243), 4)
    left = min(float(leaf.outline[:, 0].min()) for leaf in measure(scan).leaves if leaf.outline is not None)
    measured = measure(np.ascontiguousarray(scan[:, round(left) + 20 :]))
    assert any("cut off" in (leaf.note or "") for leaf in measured.leaves)
