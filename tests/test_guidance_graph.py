"""Each hint is given for a preview that lacks what it asks for, with a stand-in for the mask network."""

import functools
import math

import cv2
import numpy as np
import pytest
import tensorflow as tf
from drawn_sheets import View
from green import LEAF, mask_network
from test_ruling_estimator import draw_disk

from laesi_tf.common.geometry import ImageSize
from laesi_tf.common.run_files import PRETRAINED
from laesi_tf.estimators.graph.guidance_graph import GuidanceGraph, Hint
from laesi_tf.estimators.graph.guidance_measures import PART_PLACES, TILE_PX, VIEW_PX
from laesi_tf.models.ruling_cells import FRAME_PX
from laesi_tf.models.saved_model import load_run

SIZE = 960, 1280
LIGHT = View(*SIZE, px_per_mm=7.0)


@pytest.fixture(scope="module")
def graph() -> GuidanceGraph:
    return GuidanceGraph(mask_network((224, 224)), load_run(PRETRAINED / "ruling").model)


def guide(graph: GuidanceGraph, image: np.ndarray) -> dict[str, float]:
    """Return the outputs for a preview, uint8 [h, w, 3], as a page makes its inputs."""
    height, width = ImageSize.of(image)
    scale = VIEW_PX / max(height, width)
    small = cv2.resize(image, (round(width * scale), round(height * scale)), interpolation=cv2.INTER_AREA)
    view = np.zeros((VIEW_PX, VIEW_PX, 3), np.uint8)
    view[: small.shape[0], : small.shape[1]] = small
    rows = []
    for down in PART_PLACES:
        top = round(down * height - TILE_PX / 2)
        lefts = [round(across * width - TILE_PX / 2) for across in PART_PLACES]
        rows.append(np.concatenate([image[top : top + TILE_PX, x : x + TILE_PX] for x in lefts], 1))
    size, frame_px = np.array(small.shape[:2], np.int32), np.float32(FRAME_PX / max(height, width))
    outputs = graph.guide(*map(tf.constant, (view, size, np.concatenate(rows), frame_px)))
    return {name: float(value) for name, value in outputs.items()}


@functools.cache
def draw_complete() -> np.ndarray:
    """Return a preview that lacks nothing."""
    return draw_disk(LIGHT)[0]


def draw(name: str) -> np.ndarray:
    """Return a preview that lacks one thing."""
    image = draw_complete().copy()
    height, width = SIZE
    if name == "dark":
        return (image * 0.15).astype(np.uint8)
    if name == "blurred":
        return cv2.GaussianBlur(image, (0, 0), 5)
    if name == "shaken":
        return cv2.blur(image, (41, 1))
    if name == "plain":
        return np.full((height, width, 3), 200, np.uint8)
    if name == "far":
        return draw_disk(View(*SIZE, px_per_mm=1.9))[0]
    if name == "tilted":
        return draw_disk(View(*SIZE, px_per_mm=7.0, tilt=(math.radians(40), 0.0)))[0]
    if name == "empty":
        return cv2.inpaint(
            image, np.uint8(np.abs(image.astype(int) - LEAF).sum(-1) < 9), 3, cv2.INPAINT_TELEA
        )
    if name == "cut off":
        return image[:, width // 2 :]
    if name == "beside":
        image[:, width // 3 :] = (120, 90, 70)
        cv2.circle(image, (width * 3 // 4, height // 2), 130, LEAF, -1)
    if name == "shadow":
        image[:, : width // 2] = image[:, : width // 2] * 0.35
    return image


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("good", Hint.READY),
        ("dark", Hint.TOO_DARK),
        ("plain", Hint.NO_RULING),
        ("blurred", Hint.BLURRED),
        ("shaken", Hint.BLURRED),
        ("far", Hint.MOVE_CLOSER),
        ("tilted", Hint.TOO_TILTED),
        ("empty", Hint.NO_LEAF),
        ("cut off", Hint.LEAF_CUT_OFF),
        ("beside", Hint.LEAF_OFF_PAPER),
        ("shadow", Hint.SHADOW),
    ],
)
def test_one_hint_says_what_is_missing(graph: GuidanceGraph, name: str, hint: Hint) -> None:
    outputs = guide(graph, draw(name))
    assert Hint(int(outputs["hint"])) == hint, outputs


def test_the_distance_of_lines_is_in_pixels_of_the_frame(graph: GuidanceGraph) -> None:
    outputs = guide(graph, draw("good"))
    assert outputs["period_px"] == pytest.approx(7 * FRAME_PX / 1280, rel=0.1)
    assert outputs["leaf_share"] == pytest.approx(math.pi * 192**2 / (960 * 1280), rel=0.1)
    assert outputs["tilt_deg"] < 3
