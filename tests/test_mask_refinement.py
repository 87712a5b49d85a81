"""Refined masks from coarse probabilities, on images whose leaf is known."""

import cv2
import numpy as np
import pytest

from laesi_tf.estimators.mask_refinement import refine_mask

SIDE, COARSE = 480, 6
LEAF, PAPER, INK = (60, 110, 50), (225, 220, 205), (190, 120, 110)


def draw_leaf(leaf: np.ndarray, *, colour=LEAF, noise: float = 4.0, shadow: float = 0.0) -> np.ndarray:
    """uint8 [SIDE, SIDE, 3]: `leaf` on ruled paper, its shadow cast down and to the right."""
    image = np.full((SIDE, SIDE, 3), PAPER, np.float32)
    image[::20] = image[:, ::20] = INK
    cast = cv2.GaussianBlur(np.roll(leaf, (5, 5), (0, 1)).astype(np.float32), (0, 0), 3)
    image *= 1 - shadow * cast[..., None]
    image[leaf] = colour
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    return np.clip(image + np.random.default_rng(0).normal(0, noise, image.shape), 0, 255).astype(np.uint8)


def predict_coarsely(leaf: np.ndarray) -> np.ndarray:
    """Probability of a network with one pixel for COARSE x COARSE of `leaf`, slightly smoothed."""
    small = cv2.resize(
        leaf.astype(np.float32), None, fx=1 / COARSE, fy=1 / COARSE, interpolation=cv2.INTER_AREA
    )
    return cv2.resize(cv2.GaussianBlur(small, (0, 0), 0.9), (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)


def draw_serrated_leaf() -> np.ndarray:
    rows, columns = np.mgrid[:SIDE, :SIDE] - SIDE / 2
    radius = 150 + 8 * np.sign(np.sin(40 * np.arctan2(rows, columns)))
    return np.hypot(rows, columns * 1.4) < radius


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return (one & other).sum() / (one | other).sum()


@pytest.mark.parametrize("shadow", [0.0, 0.5])
@pytest.mark.parametrize("noise", [0.0, 12.0])
def test_serration_finer_than_the_networks_pixels_is_outlined(noise: float, shadow: float) -> None:
    leaf = draw_serrated_leaf()
    found = refine_mask(draw_leaf(leaf, noise=noise, shadow=shadow), predict_coarsely(leaf), COARSE).mask
    before = iou(predict_coarsely(leaf) >= 0.5, leaf)
    assert iou(found, leaf) > max(0.985, before + 0.01)
    assert found.sum() == pytest.approx(leaf.sum(), rel=0.008)


def test_petiole_that_the_network_misses_is_added() -> None:
    blade = draw_serrated_leaf()
    whole = blade.copy()
    whole[SIDE // 2 - 4 : SIDE // 2 + 4, 330:410] = True
    found = refine_mask(draw_leaf(whole), predict_coarsely(blade), COARSE).mask
    assert found[SIDE // 2, 400] and iou(found, whole) > 0.985


def test_lines_of_the_ruling_are_not_added() -> None:
    leaf = draw_serrated_leaf()
    found = refine_mask(draw_leaf(leaf), predict_coarsely(leaf), COARSE).mask
    assert not (found & ~(cv2.dilate(leaf.astype(np.uint8), np.ones((9, 9))) > 0)).any()


def test_holes_near_the_edge_are_kept() -> None:
    leaf = draw_serrated_leaf()
    leaf[100:112, 235:255] = False
    found = refine_mask(draw_leaf(leaf), predict_coarsely(leaf), COARSE).mask
    assert not found[103:109, 240:250].any()


def test_without_colour_contrast_the_networks_outline_remains() -> None:
    leaf = draw_serrated_leaf()
    image = draw_leaf(leaf, colour=PAPER, noise=10.0)
    network = predict_coarsely(leaf) >= 0.5
    assert iou(refine_mask(image, predict_coarsely(leaf), COARSE).mask, network) > 0.97


def test_a_neighbour_is_not_part_of_the_leaf() -> None:
    rows, columns = np.mgrid[:SIDE, :SIDE]
    leaf, other = (np.hypot(rows - 240, columns - middle) < 100 for middle in (130, 340))
    others = cv2.dilate(other.astype(np.uint8), np.ones((5, 5))) > 0
    found = refine_mask(draw_leaf(leaf | other), predict_coarsely(leaf), COARSE, others=others).mask
    assert not (found & other).any() and iou(found, leaf) > 0.98


def test_expected_errors_grow_with_noise() -> None:
    leaf = draw_serrated_leaf()
    calm, noisy = (
        refine_mask(draw_leaf(leaf, noise=noise), predict_coarsely(leaf), COARSE).expected_errors_px
        for noise in (2, 40)
    )
    assert 0 < calm < noisy


@pytest.mark.parametrize("probability", [0.0, 1.0])
def test_nothing_or_everything_is_leaf(probability: float) -> None:
    image = np.full((50, 60, 3), 128, np.uint8)
    found = refine_mask(image, np.full((50, 60), probability, np.float32), 2.0)
    assert (found.mask == (probability == 1.0)).all()


@pytest.mark.parametrize("shine", [(205, 212, 200), (150, 190, 140)])
def test_gloss_is_no_hole_and_a_hole_is(shine: tuple[int, int, int]) -> None:
    blade = draw_serrated_leaf()
    rows, columns = np.mgrid[:SIDE, :SIDE]
    hole, glossy = ((np.hypot(rows - 200, columns - x) < 26) for x in (200, 290))
    leaf = blade & ~hole
    image = draw_leaf(leaf, shadow=0.3)
    image[glossy] = np.array(shine) + np.random.default_rng(1).normal(0, 2, (glossy.sum(), 1))
    found = refine_mask(image, predict_coarsely(leaf & ~glossy), COARSE).mask
    assert found[glossy].mean() > 0.99
    assert found[hole].mean() < 0.1
