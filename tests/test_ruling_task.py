"""Labels of the ruling's cells against drawn sheets of known geometry, and the task that learns them."""

import dataclasses
import math

import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import changed

from laesi_tf.common.errors import InputError
from laesi_tf.models.ruling_cells import DIRECTION_BINS, PERIOD_BINS
from laesi_tf.models.ruling_network import RulingTargets, share_between_bins, to_bin
from laesi_tf.synthesis import Ranges, sample_scene, synthesise_ruling_crop
from laesi_tf.synthesis.geometry import pixel_centres_to_sheet
from laesi_tf.synthesis.paper.kinds import crossed_periods_mm, place_in_period, printed_lines
from laesi_tf.synthesis.paper.params import KIND_NAMES
from laesi_tf.synthesis.presets import PRESETS
from laesi_tf.synthesis.ranges import Probability
from laesi_tf.synthesis.ruling_crops import find_printed_sheet
from laesi_tf.synthesis.ruling_labels import NO, UNDECIDED, YES, RulingLabels, label_ruling
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import make_task

SIDE = 192
INNER = (slice(2, -2), slice(2, -2))
PAPER = sample_scene(0, 0, Ranges()).paper
"""Any sheet: the tests replace the numbers that matter."""


def sheet(**changes: float | bool):
    tensors = {name: tf.constant(value) for name, value in changes.items()}
    return dataclasses.replace(PAPER, **tensors)


def draw(paper, *, px_per_mm: float, angle: float, strength: float, heavy: float, blur_px: float):
    """Draw lines at every mm and heavier ones at every 5 and 10 mm that `paper` has; and `to_px`."""
    cosine, sine = math.cos(angle), math.sin(angle)
    to_px = px_per_mm * np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1 / px_per_mm]])
    centres = np.arange(SIDE) + 0.5
    x, y = np.meshgrid(centres, centres)
    on_sheet = np.stack([x * cosine + y * sine, y * cosine - x * sine]) / px_per_mm
    on_sheet += np.array([float(paper.phase_x), float(paper.phase_y)])[:, None, None]
    families = [(1, strength), (5, heavy * bool(paper.has_5mm)), (10, heavy * bool(paper.has_10mm))]
    image = np.full((SIDE, SIDE), 0.9)
    for period, depth in families:
        off = np.abs(on_sheet - period * np.round(on_sheet / period)) * px_per_mm
        width = math.hypot(0.1 * px_per_mm, blur_px, 0.4)
        image *= np.prod(1 - depth * 0.12 * px_per_mm / width * np.exp(-0.5 * (off / width) ** 2), axis=0)
    noise = np.random.default_rng(1).normal(0, 0.004, image.shape)
    grey = np.clip((image + noise) * 255, 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, -1), to_px.astype(np.float32)


def label(image, paper, to_px, bare=None) -> RulingLabels:
    bare = np.ones((SIDE, SIDE), np.float32) if bare is None else bare
    places = pixel_centres_to_sheet(tf.constant(to_px), (SIDE, SIDE))
    lines_mm = place_in_period(paper, *places) * printed_lines(paper).period_mm
    labels = label_ruling(tf.constant(image), tf.constant(bare), crossed_periods_mm(paper), lines_mm)
    return RulingLabels(*(part.numpy() for part in labels))


@settings(max_examples=12, deadline=None)
@given(px_per_mm=st.floats(3.0, 14.0), angle=st.floats(-3, 3), phase=st.floats(0, 9.9))
def test_clear_lines_are_readable_with_their_period_and_direction(px_per_mm, angle, phase):
    paper = sheet(has_5mm=True, has_10mm=True, phase_x=phase, phase_y=10 - phase)
    image, to_px = draw(paper, px_per_mm=px_per_mm, angle=angle, strength=0.8, heavy=0.9, blur_px=0.3)
    labels = label(image, paper, to_px)
    assert np.mean(labels.readable[INNER] == YES) > 0.4
    assert not (labels.readable[INNER] == NO).any()
    seen = labels.readable == YES
    fine = seen & (labels.finest_uncertain == NO)
    assert fine[INNER].mean() > 0.3
    np.testing.assert_allclose(labels.log_period[fine], math.log(px_per_mm), atol=0.01)
    turn = (labels.direction[seen] - angle / (math.pi / 2) + 0.5) % 1 - 0.5
    np.testing.assert_allclose(turn, 0, atol=0.01)


def test_fine_lines_that_blur_has_drowned_are_uncertain():
    paper = sheet(has_5mm=True, has_10mm=False)
    image, to_px = draw(paper, px_per_mm=2.0, angle=0.3, strength=0.4, heavy=0.9, blur_px=1.6)
    labels = label(image, paper, to_px)
    assert np.mean(labels.finest_uncertain[INNER] == YES) > 0.9
    np.testing.assert_allclose(labels.log_period[INNER], math.log(10), atol=0.01)


def test_what_is_not_bare_paper_is_not_readable():
    paper = sheet(has_5mm=True, has_10mm=True)
    image, to_px = draw(paper, px_per_mm=6, angle=0.1, strength=0.8, heavy=0.9, blur_px=0.3)
    bare = np.ones((SIDE, SIDE), np.float32)
    bare[:, : SIDE // 2] = 0
    readable = label(image, paper, to_px, bare).readable
    assert (readable[:, : SIDE // 32] == NO).all() and (readable[:, SIDE // 32 + 1 : -2] == YES).all()
    plain = dataclasses.replace(paper, kind=tf.constant(float(KIND_NAMES.index("plain"))))
    assert (label(image, plain, to_px).readable == NO).all()


def test_lines_that_cannot_be_seen_are_undecided():
    noise = np.random.default_rng(2).integers(90, 160, (SIDE, SIDE, 1), np.uint8).repeat(3, -1)
    paper = sheet(has_5mm=True, has_10mm=True)
    _, to_px = draw(paper, px_per_mm=6, angle=0.1, strength=0.8, heavy=0.9, blur_px=0.3)
    assert np.mean(label(noise, paper, to_px).readable == UNDECIDED) > 0.9


def test_perfect_answers_are_all_right_and_wrong_ones_are_not():
    paper = sheet(has_5mm=True, has_10mm=True)
    image, to_px = draw(paper, px_per_mm=6, angle=0.1, strength=0.8, heavy=0.9, blur_px=0.3)
    target = np.stack(label(image, paper, to_px), -1)[None]
    truth = RulingTargets(*np.moveaxis(target, -1, 0))
    periods, heaviest = (
        share_between_bins(to_bin(log), PERIOD_BINS, circular=False).numpy()
        for log in (truth.log_period, truth.log_heaviest)
    )
    directions = share_between_bins(truth.direction * DIRECTION_BINS, DIRECTION_BINS, circular=True).numpy()
    flags = np.stack([truth.readable, truth.finest_uncertain], -1) * 2 - 1
    task = make_task(TrainConfig(task="ruling"))
    right = np.concatenate([flags, periods, heaviest, directions], -1)
    assert task.aggregate(task.sample_metrics(right, target))["right"] == 100
    wrong = np.concatenate([flags, np.roll(periods, 3, -1), heaviest, directions], -1)
    metrics = task.aggregate(task.sample_metrics(wrong, target))
    assert metrics["period_right"] == 0 and metrics["right"] < 40
    assert float(task.loss(tf.constant(20 * right, tf.float32), tf.constant(target))) < float(
        task.loss(tf.constant(20 * wrong, tf.float32), tf.constant(target))
    )


@pytest.mark.parametrize(("scrap", "farther_mm"), [(False, 80.0), (True, 8.0)])
def test_labels_know_where_sheets_and_scraps_end(scrap: bool, farther_mm: float) -> None:
    margins = dict.fromkeys(("left", "right", "top", "bottom"), 80.0)
    ranges = changed(
        PRESETS["phone"],
        "paper",
        **margins,
        edged=Probability(1.0),
        cut=Probability(0.0),
        scrap=Probability(float(scrap)),
        scrap_share=0.1,
        border_mm=0.0,
    )
    outline = tf.constant([[-30.0, -20.0], [30.0, -20.0], [30.0, 20.0], [-30.0, 20.0]])
    x_mm = 30 + farther_mm + tf.constant([[-1.0, 1.0]])
    found = find_printed_sheet(sample_scene(0, 0, ranges), outline, x_mm, tf.zeros_like(x_mm))
    assert found.numpy().tolist() == [[True, False]]


def test_sides_of_crops_are_whole_cells():
    with pytest.raises(ValueError, match="multiples of 16"):
        synthesise_ruling_crop(0, size=(96, 100))


def test_the_task_takes_live_scenes_alone():
    with pytest.raises(InputError, match="live scenes"):
        TrainConfig(task="ruling", augment="flip")
