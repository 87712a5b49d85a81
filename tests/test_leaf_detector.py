"""Detection of leaves on a sheet: all of them, each once, at any size, in reading order."""

from dataclasses import replace

import keras
import numpy as np
import pytest
from green import LEAF, PAPER, mask_network
from scipy import ndimage

from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.estimators.base import PhotoInfo, sort_in_reading_order
from laesi_tf.estimators.keras_networks import make_mask_estimator
from laesi_tf.estimators.leaf_candidates import extract_candidates
from laesi_tf.estimators.leaf_colour import LeafColourParams, measure_colour
from laesi_tf.estimators.leaf_detector import LeafDetector
from laesi_tf.estimators.leaf_duplicates import remove_duplicates
from laesi_tf.estimators.photo_pyramid import OVERVIEW_SIDE_PX, PhotoPyramid
from laesi_tf.models.inference import compile_inference

SIZE = (96, 96)


def draw_sheet(discs: list[tuple[int, int, int]], size: tuple[int, int] = (900, 1200)) -> np.ndarray:
    """uint8 [*size, 3] with leaves (row, column, radius)."""
    rows, columns = np.mgrid[: size[0], : size[1]]
    image = np.full((*size, 3), PAPER, np.uint8)
    for row, column, radius in discs:
        image[np.hypot(rows - row, columns - column) < radius] = LEAF
    return image


def measure(image: np.ndarray):
    return make_mask_estimator(mask_network(SIZE), SIZE).measure(image, PhotoInfo(px_per_mm=10.0))


@pytest.mark.parametrize("radius", [30, 60, 100])
def test_every_leaf_is_found_once_and_in_order(radius: int) -> None:
    places = [(row, column) for row in (150, 450, 750) for column in (150, 450, 750, 1050)]
    leaves = measure(draw_sheet([(*place, radius) for place in places])).leaves
    middles = [leaf.outline.mean(axis=0)[::-1] for leaf in leaves]
    assert np.array(middles) == pytest.approx(np.array(places), abs=2)
    true = np.pi * (radius / 10) ** 2 / 100
    assert [leaf.area_cm2 for leaf in leaves] == pytest.approx([true] * 12, rel=0.02)


def test_leaves_missed_in_overview_and_half_of_the_tiles_are_found_by_colour() -> None:
    network, calls = compile_inference(mask_network(SIZE), SIZE), []

    def miss_leaves(images: np.ndarray) -> np.ndarray:
        calls.append(len(images))
        probability = network(images).copy()
        probability[{1: 0, 2: len(images) // 2}.get(len(calls), len(images)) :] = 0
        return probability

    places = [(row, column) for row in (150, 450, 750) for column in (150, 450, 750, 1050)]
    found = LeafDetector(miss_leaves, SIZE).find_leaves(
        PhotoPyramid(draw_sheet([(*place, 30) for place in places]))
    )
    middles = sorted(tuple(candidate.box.mean(axis=0)[::-1].round()) for candidate in found)
    assert np.array(middles) == pytest.approx(np.array(places), abs=6)


def test_leaves_of_different_size() -> None:
    leaves = measure(draw_sheet([(300, 350, 230), (500, 900, 60)])).leaves
    assert [leaf.area_cm2 for leaf in leaves] == pytest.approx(
        [np.pi * 23**2 / 100, np.pi * 6**2 / 100], rel=0.02
    )


def test_a_leaf_that_crops_of_several_miss_is_found_by_its_colour() -> None:
    """Of the two leaves, the network sees the second one only where the first is out of sight."""
    network = compile_inference(mask_network(SIZE), SIZE)

    def see_one(images: np.ndarray) -> np.ndarray:
        probability = network(images).copy()
        for one in probability:
            labels, count = ndimage.label(one[..., 0] > 0.5)
            sizes = ndimage.sum(labels > 0, labels, range(1, count + 1))
            if count > 1:
                one[labels != 1 + np.argmax(sizes)] = 0
        return probability

    image = draw_sheet([(300, 350, 200), (600, 900, 60)])
    found = LeafDetector(see_one, SIZE).find_leaves(PhotoPyramid(image))
    assert [round(candidate.length) for candidate in found] == pytest.approx([400, 120], abs=8)
    image[np.hypot(*(np.mgrid[:900, :1200] - np.array([600, 900])[:, None, None])) < 60] = (40, 40, 60)
    assert len(LeafDetector(see_one, SIZE).find_leaves(PhotoPyramid(image))) == 1


def test_neighbours_that_merge_in_one_crop_are_kept_apart() -> None:
    image = draw_sheet([(300, 300, 200), (300, 710, 200)])
    pyramid = PhotoPyramid(image)
    network = compile_inference(mask_network(SIZE), SIZE)
    detector = LeafDetector(network, SIZE)
    apart = detector.find_leaves(pyramid)
    assert len(apart) == 2
    small, letterbox = letterbox_image(image, SIZE)
    blurred = ndimage.maximum_filter(network(small[np.newaxis])[0, ..., 0], (1, 3))
    (merged,) = extract_candidates(pyramid, pyramid.overview, blurred, letterbox, 0.5, apart[0].params)
    once = [replace(candidate, sightings=1) for candidate in apart]
    assert len(remove_duplicates([merged, *once])) == 1
    for candidates in ([merged, *once, *once], [merged, *remove_duplicates(once * 2)]):
        kept = remove_duplicates(candidates)
        assert [candidate.sightings for candidate in kept] == [2, 2]


def test_ink_that_only_tiles_show_is_no_leaf() -> None:
    network = compile_inference(mask_network(SIZE), SIZE)

    def see_dark(images: np.ndarray) -> np.ndarray:
        dark = (images.mean(axis=-1, keepdims=True) < 120).astype(np.float32)
        return np.maximum(network(images), dark)

    image = draw_sheet([])
    image[::8] = (240, 200, 190)
    image[440:446, 600:640] = (30, 30, 30)
    assert LeafDetector(see_dark, SIZE).find_leaves(PhotoPyramid(image)) == []
    image[440:446, 600:640] = LEAF
    assert len(LeafDetector(see_dark, SIZE).find_leaves(PhotoPyramid(image))) == 1


@pytest.mark.parametrize("sheet", [(240, 235, 230), (25, 25, 28)])
@pytest.mark.parametrize("leaf", [(60, 110, 40), (150, 40, 45), (190, 170, 60), (110, 80, 50)])
def test_leaves_are_no_ink_on_any_sheet(sheet: tuple[int, int, int], leaf: tuple[int, int, int]) -> None:
    image = np.full((60, 60, 3), sheet, np.uint8)
    thing = np.zeros((60, 60), bool)
    thing[20:40, 20:40] = True
    image[thing] = leaf
    params = LeafColourParams()
    assert measure_colour(image, thing, params).is_ink(params) is False


def test_ink_and_what_is_known_without_colours() -> None:
    params, thing = LeafColourParams(), np.zeros((60, 60), bool)
    thing[20:40, 20:40] = True
    for ink in [(25, 25, 30), (30, 50, 150)]:
        image = np.full((60, 60, 3), (240, 225, 215), np.uint8)
        image[thing] = ink
        assert measure_colour(image, thing, params).is_ink(params)
    grey = np.full((60, 60, 3), 200, np.uint8)
    grey[thing] = 40
    assert not measure_colour(grey, thing, params).is_ink(params)
    assert not measure_colour(grey, np.zeros((60, 60), bool), params).is_known


def test_small_fragments_are_no_leaves() -> None:
    assert len(measure(draw_sheet([(300, 350, 200), (700, 900, 12)])).leaves) == 1


def test_a_leaf_that_the_photo_cuts_off_is_noted() -> None:
    first, second = measure(draw_sheet([(300, 300, 120), (850, 800, 120)])).leaves
    assert first.note is None
    assert second.note is not None and "border" in second.note
    assert second.area_cm2 is not None and second.area_cm2 < np.pi * 12**2 / 100


def test_mask_shows_all_leaves_without_their_holes() -> None:
    image = draw_sheet([(300, 350, 200), (600, 900, 150)])
    image[250:350, 300:400] = PAPER
    found = measure(image)
    true = (image == LEAF).all(axis=2)
    assert (found.mask & true).sum() / (found.mask | true).sum() > 0.99
    assert found.leaves[0].holes_cm2 == pytest.approx(1.0, rel=0.03) and len(found.leaves[0].holes) == 1
    assert found.area_cm2 == pytest.approx(true.sum() / 100 / 100, rel=0.01)


def test_reading_order() -> None:
    boxes = [[[100, 10], [150, 60]], [[0, 20], [50, 70]], [[0, 100], [40, 130]], [[60, 90], [99, 140]]]
    assert sort_in_reading_order(np.array(boxes, float)) == [1, 0, 2, 3]
    assert sort_in_reading_order(np.zeros((0, 2, 2))) == []


def test_crops_show_the_part_of_the_photo_that_they_claim() -> None:
    rows, columns = np.mgrid[:2000, :3000]
    photo = np.stack([columns // 12, rows // 12, np.zeros_like(rows)], axis=-1).astype(np.uint8)
    pyramid = PhotoPyramid(photo)
    assert max(pyramid.overview.image.shape) == OVERVIEW_SIDE_PX
    for box in ([[100, 200], [900, 700]], [[0, 0], [3000, 2000]], [[2900, 1900], [3500, 2500]]):
        crop = pyramid.crop_around(np.array(box, float), min_side=400, max_side=600)
        assert max(crop.image.shape) <= 600
        height, width = crop.image.shape[:2]
        x, y = crop.to_photo(np.array([width / 2, height / 2]))
        shown = crop.image[height // 2 - 1 : height // 2 + 1, width // 2 - 1 : width // 2 + 1, :2].mean(
            (0, 1)
        )
        assert shown * 12 == pytest.approx([x, y], abs=12)
        assert crop.from_photo(crop.to_photo(np.array([7.0, 9.0]))) == pytest.approx([7, 9])


def find_dark(size: tuple[int, int]) -> keras.Model:
    """A network that takes all that is darker than paper for leaves."""
    picture = keras.Input((*size, 3))
    finder = keras.layers.Conv2D(1, 1, activation="sigmoid")
    model = keras.Model(picture, finder(picture))
    finder.set_weights([np.full((1, 1, 3, 1), -0.1), np.array([60.0])])
    return model


COIN, INK, BROWN = (150, 110, 60), (20, 22, 34), (60, 45, 20)


def count_leaves(image: np.ndarray) -> int:
    return len(make_mask_estimator(find_dark(SIZE), SIZE).measure(image, PhotoInfo(px_per_mm=10.0)).leaves)


def draw_ellipse(
    image: np.ndarray, middle: tuple[int, int], radii: tuple[int, int], colour: tuple[int, int, int]
) -> None:
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    inside = ((rows - middle[0]) / radii[0]) ** 2 + ((columns - middle[1]) / radii[1]) ** 2 < 1
    image[inside] = colour


@pytest.mark.parametrize(
    ("radius", "count"), [(60, 1), (150, 1), (200, 1), (330, 2)], ids=["small", "larger", "twice", "huge"]
)
def test_a_coin_beside_a_green_leaf_is_left_out_unless_that_is_a_speck(radius: int, count: int) -> None:
    image = np.full((900, 1200, 3), PAPER, np.uint8)
    draw_ellipse(image, (450, 150), (180, 60), LEAF)
    draw_ellipse(image, (450, 750), (radius, radius), COIN)
    assert count_leaves(image) == count


@pytest.mark.parametrize(("other", "count"), [(INK, 1), (BROWN, 2)], ids=["ink", "brown leaf"])
def test_black_strokes_beside_a_leaf_are_ink(other: tuple[int, int, int], count: int) -> None:
    image = np.full((900, 1200, 3), PAPER, np.uint8)
    draw_ellipse(image, (450, 250), (180, 60), LEAF)
    draw_ellipse(image, (450, 800), (60, 200), other)
    assert count_leaves(image) == count
    image[:, :500] = PAPER
    assert count_leaves(image) == 1, "it is what there is"
