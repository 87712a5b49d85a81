"""Leaves beyond the lines that were read: on the sheet's paper or on the desk."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.sheet_colour import SheetColour, SheetColourParams
from laesi_tf.models.ruling_cells import CELL_PX, FRAME_CELLS

PARAMS = SheetColourParams()
PAPER, WOOD = np.array([232.0, 226, 214]), np.array([150.0, 100, 60])
RULED = np.zeros((FRAME_CELLS, FRAME_CELLS), bool)
RULED[: 900 // CELL_PX, : 500 // CELL_PX] = True
"""The cells that were read: the left of the sheet, which goes on to x = 1,000."""


def draw_photo(light: np.ndarray) -> np.ndarray:
    image = np.empty((900, 1200, 3))
    image[:, :1000], image[:, 1000:] = PAPER, WOOD
    image[::9, :1000] *= 0.85
    image[:, :1000:9] *= 0.85
    return np.clip(image * light * np.linspace(1, 0.75, 1200)[:, None], 0, 255).astype(np.uint8)


def draw_leaf(image: np.ndarray, x: float) -> np.ndarray:
    """Return the outline of a leaf at `x`, y = 450."""
    turns = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    outline = np.stack([x + 60 * np.cos(turns), 450 + 90 * np.sin(turns)], axis=1)
    rows, columns = np.mgrid[:900, :1200]
    image[((columns - x) / 60) ** 2 + ((rows - 450) / 90) ** 2 < 1] = (60, 110, 40)
    return outline


def see_colours(image: np.ndarray, cells: np.ndarray, leaves: list[np.ndarray]) -> SheetColour:
    """The colours of a photo whose whole was read."""
    overview = PhotoPyramid(image).overview
    return SheetColour(overview, overview, cells, leaves, PARAMS)


def measure_likeness(image: np.ndarray, leaf: np.ndarray) -> float:
    return see_colours(image, RULED, [leaf]).measure_likeness(leaf)


def test_neighbours_are_no_sheet_and_no_surroundings() -> None:
    image = draw_photo(np.ones(3))
    leaves = [draw_leaf(image, x) for x in range(80, 480, 130)]
    colour = see_colours(image, RULED, leaves)
    assert min(colour.measure_likeness(leaf) for leaf in leaves) > PARAMS.least_share


def test_nothing_is_said_where_little_of_the_sheet_is_seen() -> None:
    image = draw_photo(np.ones(3))
    leaf = draw_leaf(image, 900)
    assert np.isnan(see_colours(image, np.zeros_like(RULED), [leaf]).measure_likeness(leaf))


@given(x=st.floats(580, 880), light=st.tuples(*[st.floats(0.6, 1.05)] * 3))
def test_paper_around_a_leaf_is_known_in_any_light(x: float, light: tuple[float, ...]) -> None:
    image = draw_photo(np.array(light))
    assert measure_likeness(image, draw_leaf(image, x)) > PARAMS.least_share


@given(x=st.floats(1000, 1130))
def test_a_leaf_on_the_desk_is_not_on_the_sheet(x: float) -> None:
    image = draw_photo(np.ones(3))
    likeness = measure_likeness(image, draw_leaf(image, x))
    assert likeness < (PARAMS.least_share_within if x > 1100 else PARAMS.least_share)


def test_what_was_read_is_mostly_other_than_the_leafs_paper() -> None:
    image = draw_photo(np.ones(3))
    leaf = draw_leaf(image, 700)
    on_wood = np.zeros_like(RULED)
    on_wood[: 900 // CELL_PX, 1020 // CELL_PX : 1200 // CELL_PX] = True
    for cells, is_other in ((RULED, False), (on_wood, True), (RULED | on_wood, False)):
        assert see_colours(image, cells, [leaf]).is_mostly_other(leaf) == is_other


@given(left=st.integers(0, 300), top=st.integers(0, 200))
def test_cells_of_a_part_lie_where_it_lies(left: int, top: int) -> None:
    image = draw_photo(np.ones(3))
    leaf = draw_leaf(image, 650)
    pyramid = PhotoPyramid(image)
    part = pyramid.crop_around(np.array([[left, top], [1200, 900]]), min_side=1, max_side=2000)
    # Cells of the wood alone, in the part's own count.
    cells = np.zeros_like(RULED)
    cells[: (900 - top) // CELL_PX, (1020 - left) // CELL_PX : (1200 - left) // CELL_PX] = True
    assert SheetColour(pyramid.overview, part, cells, [leaf], PARAMS).measure_likeness(leaf) < 0.1
