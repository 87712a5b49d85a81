"""What the exported graph does by colour: edges, things beside leaves, what surrounds a leaf."""

import cv2
import numpy as np
import pytest
import tensorflow as tf
from test_graph_stages import SIDE, make_found, make_photo, put_in_frame

from laesi_tf.estimators.graph.close_looks import MAX_LEAVES
from laesi_tf.estimators.graph.crops import fit_square, interpolate_square, make_levels
from laesi_tf.estimators.graph.edge_refinement import FINE, refine_mask
from laesi_tf.estimators.graph.overview_colours import find_things, make_overview, paint_leaves, to_lab
from laesi_tf.estimators.graph.surroundings import (
    Likeness,
    choose_on_sheet,
    find_median,
    is_touched,
    measure_likeness,
)
from laesi_tf.estimators.leaf_colour import LeafColourParams
from laesi_tf.estimators.leaf_surroundings import SurroundingsParams
from laesi_tf.estimators.mask_refinement import MaskRefinementParams
from laesi_tf.estimators.sheet_colour import SheetColourParams

LEAF, PAPER, DESK = (70, 130, 60), (235, 230, 225), (150, 100, 60)


def distance_from(centre: tuple[float, float], side: int) -> np.ndarray:
    y, x = np.mgrid[:side, :side] + 0.5
    return np.hypot(x - centre[0], y - centre[1])


def ruled_paper(side: int) -> np.ndarray:
    paper = np.full((side, side, 3), PAPER, np.float64)
    paper[::8] = paper[:, ::8] = (225, 190, 170)
    return paper


def test_interpolation_keeps_every_place() -> None:
    photo = make_photo(900, 700)
    square = fit_square(tf.constant([100.0, 200.0, 500.0, 600.0]), tf.constant([900.0, 700.0]))
    found = interpolate_square(make_levels(put_in_frame(photo), SIDE)[:2], square, 2 * SIDE).numpy()
    places = (np.arange(2 * SIDE, dtype=np.float32) + 0.5) * 400 / (2 * SIDE) - 0.5
    expected = cv2.remap(
        photo.astype(np.float32), *np.meshgrid(places + 100, places + 200), interpolation=cv2.INTER_LINEAR
    )
    np.testing.assert_allclose(found, expected, atol=0.6)


@pytest.mark.parametrize("error_px", [-1.0, 0.0, 1.0])
def test_edges_follow_the_colours_where_the_network_is_off(error_px: float) -> None:
    fine = FINE * SIDE
    radius = 0.6 * SIDE
    cover = np.clip(radius - distance_from((fine / 2, fine / 2), fine) + 0.5, 0, 1)[..., None]
    image = ruled_paper(fine) * (1 - cover) + np.array(LEAF) * cover
    edge = radius / FINE + error_px - distance_from((SIDE / 2, SIDE / 2), SIDE)
    probability = 1 / (1 + np.exp(-1.5 * edge))
    shown, none = tf.ones([SIDE, SIDE]), tf.zeros([SIDE, SIDE])
    refined, errors = refine_mask(
        tf.constant(image, tf.float32),
        tf.constant(probability, tf.float32),
        none,
        shown,
        MaskRefinementParams(),
    )
    assert float(tf.reduce_sum(refined)) == pytest.approx(np.pi * (radius / FINE) ** 2, rel=0.01)
    assert 0 <= float(errors) < 0.1 * np.pi * radius**2


def test_colours_are_those_of_opencv() -> None:
    colours = np.random.default_rng(0).uniform(0, 1, (50, 1, 3)).astype(np.float32)
    expected = cv2.cvtColor(colours, cv2.COLOR_RGB2LAB)
    np.testing.assert_allclose(to_lab(tf.constant(colours)).numpy(), expected, atol=0.3)


def test_medians_are_of_what_is_masked() -> None:
    values = np.zeros((SIDE, SIDE, 3), np.float32)
    values[:, :40] = (1, 2, 3)
    mask = np.zeros((SIDE, SIDE), np.float32)
    mask[:, :50] = 1
    np.testing.assert_allclose(find_median(tf.constant(values), tf.constant(mask)), (1, 2, 3))


def draw_leaves(background: np.ndarray, *centres: tuple[float, float]) -> np.ndarray:
    image = background.copy()
    for centre in centres:
        image[distance_from(centre, len(image)) < 60] = LEAF
    return image.astype(np.uint8)


def disk_in_crop(centre: tuple[float, float]) -> tuple[np.ndarray, tuple[float, float, float]]:
    """The leaf of 60 pixels around `centre` in a crop of 224."""
    mask = (distance_from((SIDE / 2, SIDE / 2), SIDE) < 30).astype(float)
    return mask, (centre[0] - 112, centre[1] - 112, 224.0)


def test_a_second_leaf_of_the_same_colour_is_a_thing_and_the_first_is_not() -> None:
    size, first, second = tf.constant([600.0, 600.0]), (180.0, 200.0), (420.0, 380.0)
    photo = draw_leaves(ruled_paper(600), first, second)
    overview = make_overview(make_levels(put_in_frame(photo), SIDE), size, SIDE)
    found = make_found(disk_in_crop(first))
    painted = paint_leaves(overview, found, found.area > 0)
    pixel = 600 / SIDE
    assert float(tf.reduce_sum(painted)) * pixel**2 == pytest.approx(np.pi * 60**2, rel=0.1)
    things = find_things(overview, painted, LeafColourParams())
    near = things.near_found.numpy()[things.found.area.numpy() > 0]
    assert sorted(near > 0.5) == [False, True]
    other = int(np.argmin(np.where(things.found.area.numpy() > 0, things.near_found.numpy(), 1)))
    left, top, right, bottom = things.found.box.numpy()[other]
    assert ((left + right) / 2, (top + bottom) / 2) == pytest.approx(second, abs=2 * pixel)


def test_a_leaf_on_the_desk_is_not_surrounded_by_the_sheet() -> None:
    background = ruled_paper(600)
    background[:, 330:] = DESK
    centres = (160.0, 300.0), (450.0, 300.0)
    photo = draw_leaves(background, *centres)
    overview = make_overview(make_levels(put_in_frame(photo), SIDE), tf.constant([600.0, 600.0]), SIDE)
    found = make_found(*(disk_in_crop(centre) for centre in centres))
    is_ruled = np.zeros((96, 96), bool)
    is_ruled[:37, :20] = True
    painted = paint_leaves(overview, found, found.area > 0)
    likeness = measure_likeness(overview, painted, tf.constant(is_ruled), 16.0, SheetColourParams())
    assert likeness.is_known.numpy()[:2].all()
    assert likeness.share.numpy()[0] > 0.8 and likeness.share.numpy()[1] < 0.1


@pytest.mark.parametrize(
    ("within", "share", "lies"),
    [
        ([1.0, 1.0], [0.9, 0.9], [True, True]),
        # A scrap of paper on checked cloth that was read as ruling.
        ([1.0, 1.0], [0.1, 0.9], [False, False]),
        # A wedge of the desk.
        ([1.0, 1.0], [0.9, 0.1], [True, False]),
        # At the edge of the sheet, where a leaf hides the ruling.
        ([0.2, 1.0], [0.9, 0.5], [True, True]),
        ([0.2, 1.0], [0.5, 0.5], [False, True]),
    ],
)
def test_which_leaves_lie_on_the_sheet(within: list[float], share: list[float], lies: list[bool]) -> None:
    def fill(values: list[float]) -> tf.Tensor:
        return tf.constant(values + [0.0] * (MAX_LEAVES - 2))

    counts = tf.range(MAX_LEAVES) < 2
    found = choose_on_sheet(
        counts,
        fill(within),
        Likeness(fill(share), counts),
        on_sheet=0.5,
        is_cut_off=~counts,
        params=SheetColourParams(),
    )
    assert found.numpy()[:2].tolist() == lies and not found.numpy()[2:].any()


def test_what_continues_beyond_an_outline_touches_it() -> None:
    image = ruled_paper(SIDE)
    leaf = distance_from((SIDE / 2, SIDE / 2), SIDE) < 25
    image[leaf] = LEAF
    pen = image.copy()
    pen[SIDE // 2 - 15 : SIDE // 2 + 15, : SIDE // 2] = LEAF
    mask, seen = tf.constant(leaf, tf.float32), tf.ones([SIDE, SIDE])
    touched = [
        bool(is_touched(tf.constant(picture, tf.float32), mask, seen, SurroundingsParams()))
        for picture in (image, pen)
    ]
    assert touched == [False, True]
