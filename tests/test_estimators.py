"""Estimators with networks whose output is known."""

import math
from pathlib import Path

import cv2
import keras
import numpy as np
import pytest
from estimator_conformance import EstimatorConformance
from green import area_network, disk, mask_network, photo, save_run

from laesi_tf.common.errors import InputError
from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.estimators.keras_networks import make_area_estimator, make_mask_estimator
from laesi_tf.estimators.leaf_outline import (
    LeafOutlineParams,
    looks_like_coin,
    looks_like_note,
    looks_like_pen,
)

SIZE = (64, 64)


class TestAreaEstimator(EstimatorConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def estimator(cls) -> Estimator:
        return make_area_estimator(area_network(SIZE), SIZE, "none")


class TestMaskEstimator(EstimatorConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def estimator(cls) -> Estimator:
        return make_mask_estimator(mask_network(SIZE), SIZE)


def test_area_network_gets_the_whole_photo_with_square_pixels() -> None:
    estimator = make_area_estimator(area_network((64, 64)), (64, 64), "none")
    landscape = estimator.measure(photo(300, 600)).area_cm2
    # A disk of 0.3 of the shorter side, which is half of the input's side; the rest is padding.
    assert landscape == pytest.approx(100 * math.pi * 0.15**2, rel=0.05)


def test_area_estimator_inverts_the_transform() -> None:
    plain = make_area_estimator(area_network(SIZE), SIZE, "none").measure(photo(200, 200)).area_cm2
    root = make_area_estimator(area_network(SIZE), SIZE, "sqrt").measure(photo(200, 200)).area_cm2
    assert plain is not None and root == pytest.approx(plain**2)


def test_area_estimator_refuses_output_that_is_not_finite() -> None:
    picture = keras.Input((*SIZE, 3))
    broken = keras.Model(picture, keras.layers.Rescaling(math.nan)(keras.layers.Dense(1)(picture[:, 0, 0])))
    measured = make_area_estimator(broken, SIZE, "none").measure(photo(100, 100))
    assert measured.refusal is not None and measured.area_cm2 is None


@pytest.mark.parametrize("size", [(300, 300), (300, 450), (450, 300), (1200, 900)])
def test_mask_lies_on_the_leaf_at_the_photos_size(size: tuple[int, int]) -> None:
    mask = make_mask_estimator(mask_network((96, 96)), (96, 96)).measure(photo(*size)).mask
    assert mask is not None and mask.shape == size
    true = disk(*size)
    assert (mask & true).sum() / (mask | true).sum() > 0.95


def test_mask_times_given_scale_is_the_area() -> None:
    measured = make_mask_estimator(mask_network((96, 96)), (96, 96)).measure(
        photo(600, 600), PhotoInfo(px_per_mm=4.0)
    )
    assert measured.area_cm2 == pytest.approx(math.pi * 180**2 / 4**2 / 100, rel=0.02)
    assert measured.leaves[0].px_per_mm == 4.0


def test_without_scale_the_area_is_refused_and_the_mask_given() -> None:
    measured = make_mask_estimator(mask_network(SIZE), SIZE).measure(photo(200, 200))
    assert measured.refusal is not None and "px_per_mm" in measured.refusal
    assert measured.area_cm2 is None and measured.mask is not None and measured.leaves[0].outline is not None


def test_small_fragments_are_no_leaves() -> None:
    image = photo(200, 200)
    image[5:15, 5:15] = (40, 160, 40)
    mask = make_mask_estimator(mask_network((100, 100)), (100, 100)).measure(image).mask
    assert mask is not None and mask[100, 100] and not mask[:30, :30].any()


def test_no_leaf_is_refused() -> None:
    blank = np.full((100, 100, 3), 240, np.uint8)
    measured = make_mask_estimator(mask_network(SIZE), SIZE).measure(blank, PhotoInfo(px_per_mm=4.0))
    assert measured.refusal is not None and "no leaf" in measured.refusal
    assert measured.mask is not None and not measured.mask.any()


@pytest.mark.usefixtures("stand_in_networks")
def test_load_estimator_follows_the_runs_task(tmp_path: Path) -> None:
    area, mask = save_run(tmp_path / "area", "area"), save_run(tmp_path / "mask", "mask")
    assert load_estimator(area).measure(photo(100, 100)).mask is None
    assert load_estimator(mask_run=mask).measure(photo(100, 100)).mask is not None
    assert load_estimator(area, mask_run=mask, guess=True).measure(photo(100, 100)).area_cm2 is not None
    assert load_estimator(mask).measure(photo(100, 100)).refusal is not None
    with pytest.raises(InputError, match="--task mask"):
        load_estimator(mask_run=area)
    with pytest.raises(InputError, match="--task area"):
        load_estimator(mask, mask_run=mask, guess=True)
    with pytest.raises(InputError, match="--task ruling"):
        load_estimator(ruling_run=mask)
    with pytest.raises(InputError, match="without --mask-model"):
        load_estimator(area, mask_run=mask)
    with pytest.raises(InputError, match="without --guess"):
        load_estimator("rule_based", guess=True)


@pytest.mark.parametrize("turn", [0, 25, 90])
def test_notes_and_coins_are_not_leaves_and_leaves_neither(turn: int) -> None:
    params = LeafOutlineParams()
    note = cv2.boxPoints(((300.0, 200.0), (120.0, 80.0), float(turn)))
    coin = np.array(cv2.ellipse2Poly((300, 200), (60, 54), turn, 0, 360, 3), float)
    leaflet = np.array(cv2.ellipse2Poly((300, 200), (90, 45), turn, 0, 360, 3), float)
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    radius = 80 * (1 + 0.12 * np.sin(5 * angle))
    lobed = np.stack([300 + radius * np.cos(angle), 200 + radius * np.sin(angle)], 1)
    assert looks_like_note(note, params) and looks_like_coin(coin, params)
    for leaf in (leaflet, lobed):
        assert not looks_like_note(leaf, params) and not looks_like_coin(leaf, params)


@pytest.mark.parametrize("turn", [0, 25, 90])
def test_pens_are_not_leaves_and_slender_leaves_not_pens(turn):
    params = LeafOutlineParams()
    pen = cv2.boxPoints(((300.0, 200.0), (400.0, 40.0), float(turn)))
    leaf = cv2.ellipse2Poly((300, 200), (200, 20), turn, 0, 360, 3)
    assert looks_like_pen(pen, params) and not looks_like_pen(leaf, params)
    assert not looks_like_pen(cv2.boxPoints(((300.0, 200.0), (400.0, 200.0), float(turn))), params)
