"""Petioles that a network sees as chains of links, on drawn probabilities and photos."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from laesi_tf.common.geometry import ImageSize
from laesi_tf.data.letterbox import compute_letterbox
from laesi_tf.estimators.leaf_candidates import LeafCandidate, LeafDetectorParams, extract_candidates
from laesi_tf.estimators.leaf_outline import LeafOutlineParams, add_petiole, outline_leaf
from laesi_tf.estimators.petiole_chain import PetioleChainParams, find_chain
from laesi_tf.estimators.photo_pyramid import PhotoPyramid

SIDE, PIXEL = 112, 4
"""Side of the network's input, and how many photo pixels one of its pixels is wide."""
BLADE, PAPER, RED = (60, 110, 50), (225, 220, 205), (120, 45, 40)
BASE, LENGTH = 76, 24
"""Column at which the petiole begins, and its length, in network pixels."""


def draw_blade() -> np.ndarray:
    blade = np.zeros((SIDE, SIDE), np.float32)
    return cv2.ellipse(blade, (50, 56), (26, 18), 0, 0, 360, 1.0, -1)


def draw_chain(*, gap: int = 2, link: int = 4, peak: float = 0.9, half_width: int = 1) -> np.ndarray:
    """Probability of a blade and of links along row 56 from its end, `gap` network pixels apart."""
    probability = draw_blade()
    for start in range(BASE + 1 + gap, BASE + LENGTH - link, link + gap):
        probability[56 - half_width : 56 + half_width, start : start + link] = peak
    return cv2.GaussianBlur(probability, (3, 3), 0.5)


def find_candidate(probability: np.ndarray, image: np.ndarray | None = None) -> LeafCandidate:
    if image is None:
        image = np.full((SIDE * PIXEL, SIDE * PIXEL, 3), PAPER, np.uint8)
    pyramid = PhotoPyramid(image)
    letterbox = compute_letterbox(image.shape[:2], (SIDE, SIDE))
    found = extract_candidates(pyramid, pyramid.photo, probability, letterbox, 0.5, LeafDetectorParams())
    return max(found, key=lambda candidate: candidate.area)


@settings(max_examples=20, deadline=None)
@given(gap=st.integers(1, 5), link=st.integers(2, 6), quarter_turns=st.integers(0, 3))
def test_a_chain_of_links_is_found_whole(gap: int, link: int, quarter_turns: int) -> None:
    probability = draw_chain(gap=gap, link=link)
    chain = find_chain(find_candidate(np.rot90(probability, quarter_turns).copy()), PetioleChainParams())
    assert chain is not None
    chain = np.rot90(chain, -quarter_turns)
    last = int(np.flatnonzero((probability >= 0.5).any(axis=0)).max())
    # Its gaps are bridged, and it is no wider than its links.
    assert chain[:, BASE + 4 : last + 1].any(axis=0).all()
    assert not chain[:52].any() and not chain[60:].any()


@pytest.mark.parametrize(
    "probability",
    [
        pytest.param(draw_blade(), id="no links"),
        pytest.param(draw_chain(peak=0.35), id="faint everywhere, as a printed line"),
        pytest.param(draw_chain(gap=1, half_width=8), id="wide, as a finger"),
        pytest.param(draw_chain(gap=12), id="too far away"),
    ],
)
def test_what_is_no_chain_is_left_out(probability: np.ndarray) -> None:
    assert find_chain(find_candidate(probability), PetioleChainParams()) is None


@pytest.mark.parametrize("colour", [BLADE, RED], ids=["of the blade's colour", "red"])
def test_the_petiole_is_outlined_at_the_photos_resolution(colour: tuple[int, int, int]) -> None:
    side = SIDE * PIXEL
    blade = cv2.resize(draw_blade(), (side, side), interpolation=cv2.INTER_LINEAR) > 0.5
    petiole = np.zeros((side, side), bool)
    petiole[56 * PIXEL - 3 : 56 * PIXEL + 3, BASE * PIXEL - 8 : (BASE + LENGTH) * PIXEL] = True
    image = np.full((side, side, 3), PAPER, np.float32)
    image[::10] = image[:, ::10] = (190, 120, 110)
    image[petiole], image[blade] = colour, BLADE
    image += np.random.default_rng(0).normal(0, 3, image.shape)
    photo = np.clip(cv2.GaussianBlur(image, (0, 0), 0.7), 0, 255).astype(np.uint8)
    params, size = LeafOutlineParams(), ImageSize(side, side)
    candidate = find_candidate(draw_chain(), photo)
    outline = outline_leaf(candidate, size, params)
    assert outline is not None
    extended = add_petiole(outline, size, params)
    whole = np.count_nonzero(blade | petiole)
    assert np.count_nonzero(extended.mask) == pytest.approx(whole, rel=0.006)
    beyond = np.count_nonzero(petiole & ~blade)
    assert np.count_nonzero(extended.mask & petiole & ~blade) > 0.8 * beyond
    assert np.count_nonzero(outline.mask & petiole & ~blade) < 0.8 * beyond or colour == BLADE
