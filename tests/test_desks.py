"""Kinds of desk, and sheets that are cut to any shape."""

import math

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, middle

from laesi_tf.synthesis.paper.desk import DESK_NAMES, GRAIN_NODES, DeskParams
from laesi_tf.synthesis.paper.desk_kinds import DESK_COLOURS, desk_colour, desk_pattern
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.paper.sheet import distance_to_any_sheet_edge, distance_to_sheet_edge, find_sheet
from laesi_tf.synthesis.presets import PRESETS

SIZE = (64, 96)
GRID = tf.constant(np.random.default_rng(3).uniform(size=(GRAIN_NODES, GRAIN_NODES)).astype(np.float32))
LEAF = tf.constant([[-20.0, 0.0], [0.0, -8.0], [20.0, 0.0], [0.0, 8.0]])


def desk_of(kind: str, **given: float | bool) -> DeskParams:
    return middle(DeskParams(), kind=float(DESK_NAMES.index(kind)), **({"angle": 0.0} | given))


def pattern(desk: DeskParams, px_per_mm: float) -> np.ndarray:
    """Return the brightness of `desk` in an image of `px_per_mm`."""
    y, x = ((np.indices(SIZE) + 0.5) / px_per_mm).astype(np.float32)
    return desk_pattern(desk, GRID, tf.constant(x), tf.constant(y), tf.constant(px_per_mm), SIZE).numpy()


def test_every_desk_has_its_name() -> None:
    assert tuple(DESK_COLOURS) == DESK_NAMES
    assert PRESETS["phone"].has("desk_kinds") and not RENDERING_2.has("desk_kinds")


@pytest.mark.parametrize("kind", DESK_NAMES)
def test_desks_are_seen_and_fade_to_their_mean(kind: str) -> None:
    desk = desk_of(kind, thread_mm=3.0)
    near, far = pattern(desk, 4.0), pattern(desk, 0.05)
    for image in (near, far):
        assert np.isfinite(image).all() and image.min() > 0 and image.max() < 2
    if kind in ("checked", "text", "woven"):
        assert near.std() > 0.05 and far.std() < 0.5 * near.std()
    assert near.std() > 0.001
    colour = desk_colour(desk).numpy()
    assert colour.shape == (3, 1, 1) and 0 < colour.max() <= 1


def test_tiles_have_their_size_in_millimetres() -> None:
    made = pattern(
        desk_of("tiles", board_mm=8.0, tile_aspect=1.5, bonded=False, hue_share=0.0, grain=0.0), 8.0
    )
    rows, columns = (made.mean(axis=axis) for axis in (1, 0))
    assert np.argmin(rows[32:96]) + 32 in (63, 64) or np.argmin(rows) in (0, 63)
    assert abs(int(np.argmin(columns[48:144])) + 48 - 96) <= 8 or np.argmin(columns) in (0, 95)


def test_uncut_sheets_are_those_of_the_paper() -> None:
    sheet = middle(PaperParams(), left=5.0, right=12.0, top=3.0, bottom=40.0, cut=False, scrap=False)
    x, y = (
        tf.constant(axis, tf.float32)
        for axis in np.meshgrid(np.linspace(-60, 60, 9), np.linspace(-60, 60, 7))
    )
    np.testing.assert_allclose(
        distance_to_any_sheet_edge(sheet, LEAF, x, y), distance_to_sheet_edge(sheet, LEAF, x, y), atol=1e-4
    )


@pytest.mark.parametrize("turn", [0.0, 0.8, -2.5])
def test_cut_scraps_keep_their_margins_around_the_leaf(turn: float) -> None:
    margins = {"left": 20.0, "right": 20.0, "top": 20.0, "bottom": 20.0}
    cuts = {"cut_left": 0.2, "cut_right": -0.1, "cut_top": 0.0, "cut_bottom": 0.3}
    sheet = middle(PaperParams(), cut=True, scrap=True, scrap_share=0.25, cut_turn=turn, **margins, **cuts)
    x, y = tf.unstack(LEAF, axis=1)
    on_leaf = distance_to_any_sheet_edge(sheet, LEAF, x, y).numpy()
    assert on_leaf.min() == pytest.approx(5.0, abs=1e-3)
    # Away from the leaf the sheet ends, each side at its own angle.
    angle = np.linspace(0, 2 * math.pi, 721)[:-1]
    ring = [tf.constant(30 * part, tf.float32) for part in (np.cos(angle), np.sin(angle))]
    distance = distance_to_any_sheet_edge(sheet, LEAF, *ring).numpy()
    assert distance.min() < -5 and distance.max() < 25


def test_border_of_cut_sheets_is_cut_off() -> None:
    """Printing ends where the ruling's labels say it does."""
    place = tf.zeros([1]), tf.zeros([1])
    for cut, border_mm in ((False, 7.0), (True, 0.0)):
        sheet = middle(PaperParams(), cut=cut, border_mm=7.0)
        assert float(find_sheet(sheet, LEAF, *place, ("cut_sheet",))[1]) == border_mm
        assert float(find_sheet(sheet, LEAF, *place, ())[1]) == 7
