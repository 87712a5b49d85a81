"""The stages of the exported graph against what the estimators compute, and against LiteRT."""

import cv2
import numpy as np
import pytest
import tensorflow as tf
from green import disk

from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.estimators.graph.close_looks import MAX_LEAVES, Found
from laesi_tf.estimators.graph.components import find_components
from laesi_tf.estimators.graph.crops import cut_square, fit_square, make_levels
from laesi_tf.estimators.graph.gloss import fill_gloss
from laesi_tf.estimators.graph.leaf_measures import (
    LeafMeasureParams,
    Sheet,
    choose_distinct,
    measure_leaves,
    measure_share_on,
)
from laesi_tf.estimators.graph.leaf_shapes import judge_shapes
from laesi_tf.estimators.graph.photo_graph import px_per_mm_to_sheet
from laesi_tf.estimators.leaf_candidates import LeafDetectorParams
from laesi_tf.estimators.leaf_outline import LeafOutlineParams
from laesi_tf.estimators.litert_file import LiteRtRunner
from laesi_tf.estimators.mask_refinement import MaskRefinementParams
from laesi_tf.models.ruling_cells import FRAME_PX

SIDE = 112


def make_photo(height: int, width: int) -> np.ndarray:
    """A smooth picture in which every place has its own colour."""
    y, x = np.mgrid[:height, :width]
    channels = [128 + 100 * np.sin(x / 37), 128 + 100 * np.cos(y / 53), 128 + 90 * np.sin((x + y) / 71)]
    return np.stack(channels, -1).astype(np.uint8)


def put_in_frame(photo: np.ndarray) -> tf.Tensor:
    frame = np.zeros((FRAME_PX, FRAME_PX, 3), np.uint8)
    frame[: photo.shape[0], : photo.shape[1]] = photo
    return tf.constant(frame)


@pytest.mark.parametrize(
    "box", [(0, 0, 900, 700), (300, 200, 500, 400), (-50, 600, 150, 800), (700, 100, 1000, 400)], ids=str
)
def test_a_crop_is_what_letterbox_makes_of_it(box: tuple[int, int, int, int]) -> None:
    photo = make_photo(700, 900)
    size = tf.constant([700.0, 900.0])
    square = fit_square(tf.constant(box, tf.float32), size)
    found = cut_square(make_levels(put_in_frame(photo), SIDE), square, SIDE).numpy()
    left, top, right, bottom = np.clip(box, 0, [900, 700, 900, 700])
    expected, _ = letterbox_image(photo[top:bottom, left:right], (SIDE, SIDE))
    difference = np.abs(found - expected)
    # A letterbox begins at whole pixels, half a pixel off at most; so does padding, of the same colour.
    assert difference.mean() < 4 and np.percentile(difference, 95) < 15
    assert float(square.side) == max(right - left, bottom - top)


def test_components_are_those_of_opencv_and_run_in_litert() -> None:
    random = np.random.default_rng(0)
    blobs = cv2.GaussianBlur(random.normal(size=(SIDE, SIDE)), (0, 0), 5)
    mask = (blobs > 0.06).astype(np.float32)
    # OpenCV on the same coarse pixels.
    coarse = mask.reshape(SIDE // 2, 2, SIDE // 2, 2).max((1, 3)).astype(np.uint8)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(coarse)
    wide = labels.repeat(2, 0).repeat(2, 1) * (mask > 0)
    expected = sorted(np.bincount(wide.ravel(), minlength=count)[1:], reverse=True)[:16]
    graph = tf.function(
        lambda mask: find_components(mask)._asdict(), input_signature=[tf.TensorSpec([SIDE, SIDE])]
    )
    module = tf.Module()
    converter = tf.lite.TFLiteConverter.from_concrete_functions([graph.get_concrete_function()], module)
    for found in (
        {name: value.numpy() for name, value in graph(tf.constant(mask)).items()},
        LiteRtRunner(converter.convert())(mask=mask),
    ):
        counts = found["count"]
        np.testing.assert_array_equal(counts[counts > 0], expected)
        largest = 1 + np.argmax([(wide == label).sum() for label in range(1, count)])
        left, top, width, height = statistics[largest, :4] * 2
        np.testing.assert_array_equal(found["boxes"][0], [left, top, left + width, top + height])


def make_found(*leaves: tuple[np.ndarray, tuple[float, float, float]]) -> Found:
    """Leaves, probabilities [s, s] with the squares that show them."""
    side = leaves[0][0].shape[0]
    area, square, box = np.zeros(MAX_LEAVES), np.zeros((MAX_LEAVES, 3)), np.zeros((MAX_LEAVES, 4))
    leaf = np.zeros((MAX_LEAVES, side, side))
    for index, (mask, where) in enumerate(leaves):
        pixel = where[2] / side
        rows, columns = np.nonzero(mask >= 0.5)
        area[index] = len(rows) * pixel**2
        square[index], leaf[index] = where, mask
        corners = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        box[index] = corners * pixel + [*where[:2], *where[:2]]
    return Found(*(tf.constant(part, tf.float32) for part in (area, square, box, leaf)))


def soft_disk(radius: float, side: int = SIDE) -> np.ndarray:
    y, x = np.mgrid[:side, :side] + 0.5
    distance = np.hypot(x - side / 2, y - side / 2)
    return np.clip(radius - distance + 0.5, 0, 1)


def test_a_disk_on_a_flat_sheet() -> None:
    size = tf.constant([900.0, 1200.0])
    sheet = Sheet(px_per_mm_to_sheet(tf.constant(5.0), size), tf.constant(1.0), size)
    found = make_found((soft_disk(40), (300.0, 200.0, 224.0)))
    measures = measure_leaves(found, sheet, LeafMeasureParams())
    radius_mm = 40 * 2 / 5
    assert float(measures.area_mm2[0]) == pytest.approx(np.pi * radius_mm**2, rel=2e-3)
    assert float(measures.length_mm[0]) == pytest.approx(2 * radius_mm, rel=0.02)
    assert float(measures.width_mm[0]) == pytest.approx(2 * radius_mm, rel=0.02)
    np.testing.assert_allclose(measures.middle[0], [412, 312], atol=0.5)
    assert not bool(measures.is_cut_off[0])
    at_border = make_found((soft_disk(40), (-33.0, 200.0, 224.0)))
    assert bool(measure_leaves(at_border, sheet, LeafMeasureParams()).is_cut_off[0])


def test_a_tilted_sheet_counts_each_pixel_by_what_it_covers() -> None:
    size = tf.constant([1000.0, 1000.0])
    parameters = tf.constant([0.3, -0.2, 90, 5, -6, 88, 0.15, -0.1, 0.02, 0.05, 0, 0.003, 0, 0.002])
    sheet = Sheet(parameters, tf.constant(1.0), size)
    found = make_found((soft_disk(45), (500.0, 100.0, 400.0)))
    measures = measure_leaves(found, sheet, LeafMeasureParams())
    centres = (np.arange(SIDE) + 0.5) * 400 / SIDE
    points = np.stack(np.meshgrid(500 + centres, 100 + centres), -1).astype(np.float32)
    expected = (sheet.mm2_per_px(tf.constant(points)).numpy() * soft_disk(45)).sum() * (400 / SIDE) ** 2
    assert float(measures.area_mm2[0]) == pytest.approx(expected, rel=3e-4)


def test_fragments_and_parts_of_larger_leaves_do_not_count() -> None:
    whole = (soft_disk(40), (300.0, 200.0, 224.0))
    again = (soft_disk(36), (302.0, 198.0, 224.0))
    apart = (soft_disk(30), (700.0, 200.0, 224.0))
    speck = (soft_disk(6), (700.0, 600.0, 224.0))
    found, counts = choose_distinct(make_found(speck, again, whole, apart), LeafDetectorParams())
    assert counts.numpy()[:4].tolist() == [True, False, True, False] and not counts.numpy()[4:].any()
    np.testing.assert_allclose(found.square[0], whole[1])


def test_what_lies_beside_the_ruled_cells() -> None:
    agreement = np.zeros((96, 96), np.float32)
    agreement[10:40, 10:30] = 1
    inside, half = (200.0, 200.0, 224.0), (368.0, 200.0, 224.0)
    found = make_found((soft_disk(40), inside), (soft_disk(40), half), (soft_disk(40), (700.0, 200.0, 224.0)))
    shares = measure_share_on(found, tf.constant(agreement), least=0.3, cell_px=16.0).numpy()
    np.testing.assert_allclose(shares[:3], [1, 0.5, 0], atol=0.06)


def test_notes_pens_and_coins_are_told_from_leaves() -> None:
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5 - SIDE / 2
    turned, across = x * np.cos(0.4) + y * np.sin(0.4), y * np.cos(0.4) - x * np.sin(0.4)
    note = (np.abs(turned) < 40) & (np.abs(across) < 30)
    pen = (np.abs(turned) < 45) & (np.abs(across) < 5)
    lens = (np.abs(across) < 18 * (1 - (turned / 45) ** 2)) & (np.abs(turned) < 45)
    coin = (turned / 40) ** 2 + (across / 34) ** 2 < 1
    square = (100.0, 100.0, 224.0)
    found = make_found(*((shape.astype(float), square) for shape in (note, pen, lens, coin)))
    looks_made, looks_round = judge_shapes(found, LeafOutlineParams())
    assert looks_made.numpy()[:4].tolist() == [True, True, False, False]
    assert looks_round.numpy()[:4].tolist() == [False, False, False, True]


def test_gloss_is_filled_and_a_hole_that_shows_paper_is_not() -> None:
    image = np.full((SIDE, SIDE, 3), 235.0)
    image[::4] = image[:, ::4] = 150
    leaf = disk(SIDE, SIDE, radius=0.4)
    image[leaf] = (60, 120, 50)
    probability = leaf * 0.98
    hole, gloss = (slice(40, 50), slice(40, 50)), (slice(60, 68), slice(50, 60))
    probability[hole] = probability[gloss] = 0.05
    image[hole] = np.where((np.mgrid[40:50, 40:50] % 4 == 0).any(0)[..., None], 150, 235)
    image[gloss] = (200, 230, 200)
    filled = fill_gloss(
        tf.constant(probability, tf.float32), tf.constant(image, tf.float32), MaskRefinementParams()
    ).numpy()
    assert (filled[gloss] == 1).all() and (filled[hole] < 0.1).all()
    assert (filled[~leaf] == 0).all()


def test_a_strip_thinner_than_a_network_pixel_is_cropped() -> None:
    size = tf.constant([1.0, 500.0])
    square = fit_square(tf.constant([0.0, 0.0, 500.0, 1.0]), size)
    crop = cut_square(make_levels(put_in_frame(make_photo(1, 500)), SIDE), square, SIDE)
    assert np.isfinite(crop.numpy()).all()
