"""Whole images: the label is true, also at the ends of every range; each component is visible."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
import tensorflow as tf
from homographies import compute_px_per_mm
from scenes import (
    RENDERING_2,
    bounds,
    changed,
    complete,
    difference,
    only,
    parts_of,
    ranges_of_parts,
    with_parts,
)

from laesi_tf.common.geometry import polygon_centroid
from laesi_tf.data.synthetic import synthetic_samples
from laesi_tf.synthesis import Ranges, Scene, render_scene, sample_scene, synthesise
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Choice, Probability, field_count, fields_of, sample_params_of_kind
from laesi_tf.synthesis.renderer import compute_layout
from laesi_tf.synthesis.scene_layout import leaf_edges

SINGLY = RENDERING_2.with_passes(1)
FULL = complete()
BARE = only()
"""A leaf on a plain sheet: compiled in a second, for tests of label and mask."""
KINDS = [kind for _, kind in SINGLY.leaf.values()]
ONE_KIND = dataclasses.replace(SINGLY, leaf=dict([next(iter(SINGLY.leaf.items()))]))
SMALL = (96, 96)


def mask_mm2(mask: np.ndarray, to_px: np.ndarray) -> float:
    """Return the area on the sheet of the pixels of `mask` [H, W], whose sizes follow from the homography."""
    rows, columns = np.nonzero(mask)
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))]).astype(np.float64)
    matrix = to_px.astype(np.float64)
    x, y, w = np.linalg.inv(matrix) @ pixels
    depth = matrix[2] @ np.stack([x / w, y / w, np.ones_like(w)])
    return float(np.sum(np.abs(depth**3 / np.linalg.det(matrix))))


def test_an_empty_sheet_has_neither_leaf_nor_area() -> None:
    ranges = dataclasses.replace(SINGLY, without=only("ruling", "shadow").without - {"empty_sheet"})
    empty = changed(ranges, "paper", empty=Probability(1.0))
    assert empty.has("empty_sheet") and not SINGLY.has("empty_sheet")
    made = synthesise(5, size=SMALL, ranges=empty)
    with_leaf = synthesise(5, size=SMALL, ranges=empty.without_empty_sheets())
    assert not made["mask"].numpy().any() and float(made["area_cm2"]) == 0
    assert with_leaf["mask"].numpy().any() and float(with_leaf["area_cm2"]) > 0
    # Empty sheets are seen from closer.
    assert float(made["px_per_mm"]) > 1.2 * float(with_leaf["px_per_mm"])
    assert made["image"].numpy().std() < 0.5 * with_leaf["image"].numpy().std()


def test_mask_and_label_agree_on_200_untilted_scenes() -> None:
    flat = changed(only(ranges=SINGLY), "camera", tilted=Probability(0.0))
    errors = []
    for made in synthetic_samples(seed=11, size=(512, 512), ranges=flat, count=200).as_numpy_iterator():
        found = made["mask"].sum(dtype=np.int64) / made["px_per_mm"] ** 2 / 100
        errors.append((found - made["area_cm2"]) / made["area_cm2"])
        assert largest_piece(made["mask"]) > 0.99
    assert np.mean(np.abs(errors)) <= 0.003 and np.max(np.abs(errors)) <= 0.01
    assert abs(np.median(errors)) <= 0.0002  # the mask errs to neither side


def test_mask_and_label_agree_on_tilted_scenes() -> None:
    tilted = changed(only(ranges=SINGLY), "camera", tilted=Probability(1.0), tilt_deg=(10, 20))
    errors, naive = [], []
    for made in synthetic_samples(seed=12, size=(768, 640), ranges=tilted, count=40).as_numpy_iterator():
        found = mask_mm2(made["mask"], made["to_px"]) / 100
        errors.append(abs(found - made["area_cm2"]) / made["area_cm2"])
        flat = made["mask"].sum(dtype=np.int64) / made["px_per_mm"] ** 2 / 100
        naive.append(abs(flat - made["area_cm2"]) / made["area_cm2"])
    assert np.mean(errors) <= 0.003 and np.max(errors) <= 0.01
    assert np.max(naive) > 0.01  # tilt matters: one scale for the whole image is not enough


@pytest.fixture(scope="module")
def render_with() -> Callable[..., dict[str, tf.Tensor]]:
    """Render image `index` with a leaf of `kind` and parameter number `which` set to `value`."""

    @tf.function(autograph=False)
    def render(index: tf.Tensor, kind: tf.Tensor, which: tf.Tensor, value: tf.Tensor) -> dict[str, tf.Tensor]:
        scene = sample_scene(5, index, SINGLY)
        uniform = RandomStreams(5, index).uniform([field_count(KINDS[0])], Stream.LEAF)
        scene = dataclasses.replace(scene, leaf=sample_params_of_kind(KINDS, kind, uniform))
        return render_scene(_set(scene, which, value), (160, 160))

    return render


def _fields() -> list[tuple[str, str]]:
    """(part, field) of each parameter of a scene."""
    return [(part, field) for part, ranges in ranges_of_parts(SINGLY).items() for field in fields_of(ranges)]


def _set(scene: Scene, which: tf.Tensor, value: tf.Tensor) -> Scene:
    parts = parts_of(scene)
    for number, (part, field) in enumerate(_fields()):
        sampled = getattr(parts[part], field)
        chosen = value > 0.5 if sampled.dtype == tf.bool else value
        parts[part] = dataclasses.replace(parts[part], **{field: tf.where(which == number, chosen, sampled)})
    return with_parts(scene, parts)


def _extremes() -> Iterator[tuple[str, int, int, float]]:
    """(name, kind of leaf, number, value) at both ends of every range of every part and kind of leaf."""
    seen = set()
    for number, (part, field) in enumerate(_fields()):
        kinds = range(len(KINDS)) if part == "leaf" else [number % len(KINDS)]
        for kind in kinds:
            ranges = KINDS[kind] if part == "leaf" else ranges_of_parts(SINGLY)[part]
            for value in bounds(getattr(ranges, field)):
                # Ends that several kinds of leaf share are checked once.
                if (number, value) not in seen:
                    yield f"{part}.{field} = {value}", kind, number, float(value)
                seen.add((number, value))


def test_images_at_the_extremes_of_every_range(render_with: Callable[..., dict[str, tf.Tensor]]) -> None:
    for index, (name, kind, which, value) in enumerate(_extremes()):
        made = render_with(
            tf.constant(index, tf.int64), tf.constant(kind), tf.constant(which), tf.constant(value)
        )
        require_sound(
            name, *(made[key].numpy() for key in ("image", "mask", "area_cm2", "px_per_mm", "to_px"))
        )


def require_sound(
    name: str, image: np.ndarray, mask: np.ndarray, area_cm2: float, px_per_mm: float, to_px: np.ndarray
) -> None:
    """Require finite numbers in range, the leaf in one piece within the image, mask and label that agree."""
    side = image.shape[0]
    assert image.std() > 0.5, name
    assert np.isfinite([area_cm2, px_per_mm, *to_px.ravel()]).all(), name
    assert 0.3 < area_cm2 < 250, name
    # Tilt and large leaves make the view wider than its limit; tilt makes it a little closer.
    assert side / 400 < px_per_mm < 1.1 * side / 70, name
    border = np.concatenate([mask[[0, -1]].ravel(), mask[:, [0, -1]].ravel()])
    assert set(np.unique(mask)) == {0, 1} and not border.any(), name
    assert mask_mm2(mask, to_px) / 100 == pytest.approx(area_cm2, rel=0.06, abs=0.15), name
    assert largest_piece(mask) > 0.97, name


def largest_piece(mask: np.ndarray) -> float:
    """Return the share of the largest piece of `mask`: petioles thinner than a pixel may be separate."""
    sizes = cv2.connectedComponentsWithStats(mask)[2][1:, cv2.CC_STAT_AREA]
    return sizes.max() / sizes.sum()


@pytest.mark.parametrize("size", [(0, 64), (64,), (64.0, 64), (64, 64, 3)])
def test_sizes_are_checked(size: Any) -> None:
    with pytest.raises(ValueError, match="expected \\(height, width\\)"):
        synthesise(0, size=size)


def test_scale_is_that_at_the_centroid_of_the_leaf() -> None:
    for index in range(12):
        layout = compute_layout(sample_scene(6, index, SINGLY), (200, 300))
        to_px = layout.view.to_px.numpy().astype(np.float64)
        centroid = polygon_centroid(layout.outline.numpy().astype(np.float64))
        in_image = cv2.perspectiveTransform(centroid.reshape(1, 1, 2), to_px)[0, 0]
        expected = compute_px_per_mm(np.linalg.inv(to_px), in_image)
        assert float(layout.view.px_per_mm) == pytest.approx(expected, rel=1e-4)


def test_outline_lies_within_the_image() -> None:
    for index in range(40):
        edges = leaf_edges(compute_layout(sample_scene(6, index, SINGLY), (200, 300)), (200, 300)).numpy()
        corners = edges.reshape(-1, 2)
        assert (corners >= [6 - 0.1, 4 - 0.1]).all() and (corners <= [294.1, 196.1]).all()


def _strong() -> Ranges:
    """Return ranges in which every component is clearly visible."""
    strong = changed(FULL, "surface", undulation=(0.7, 1.0))
    strong = changed(strong, "light", relief=(0.6, 0.9))
    strong = changed(strong, "camera", fill=(0.35, 0.45), blur_mm=0.25, place_x=0.5, place_y=0.5)
    return changed(strong, "props", gap_mm=(2, 4))


@functools.cache
def _render_strong(size: tuple[int, int], index: int) -> dict[str, tf.Tensor]:
    return synthesise(7, size=size, ranges=_strong(), index=index)


@pytest.mark.parametrize("component", FULL.list_enabled_components())
def test_each_component_is_visible_and_keeps_mask_and_label(component: str) -> None:
    without = dataclasses.replace(_strong(), without=frozenset({component}))
    size = (320, 320) if component == "focus" else SMALL  # blur of a quarter millimetre needs pixels
    shown = []
    for index in range(2):
        full = _render_strong(size, index)
        lacking = synthesise(7, size=size, ranges=without, index=index)
        for key in set(full) - {"image"}:
            np.testing.assert_array_equal(full[key], lacking[key], err_msg=key)
        shown.append(np.mean(difference(full["image"], lacking["image"]) >= 2))
    assert max(shown) > 0.001


PRESENCE = {
    "crease": ("paper", "creased"),
    "desk": ("paper", "edged"),
    **{name: ("props", name) for name in ("fragment", "label", "pen", "coin", "handwriting", "calibration")},
    "browned_margin": ("surface", "margin_browned"),
    "spots": ("surface", "spotted"),
    "glass": ("light", "glass"),
    "focus": ("camera", "blurred"),
    "chroma_softness": ("camera", "compressed"),
}


@pytest.mark.parametrize("component", PRESENCE)
def test_no_chance_is_the_same_as_left_out(component: str) -> None:
    room, field = PRESENCE[component]
    never = changed(FULL, room, **{field: Probability(0.0)})
    without = dataclasses.replace(FULL, without=frozenset({component}))
    made = [synthesise(7, size=SMALL, ranges=ranges, index=1)["image"] for ranges in (never, without)]
    assert difference(*made).max() <= 1


def test_lighting_passes_share_all_but_the_light() -> None:
    made = [synthesise(8, size=SMALL, index=index) for index in range(5)]
    for one, other in itertools.pairwise(made[:4]):
        for key in ("mask", "area_cm2", "px_per_mm", "to_px"):
            np.testing.assert_array_equal(one[key], other[key])
        assert np.mean(difference(one["image"], other["image"]) > 3) > 0.2
    assert float(made[4]["area_cm2"]) != float(made[0]["area_cm2"])


@pytest.mark.parametrize("size", [(64, 64), (160, 96), (100, 230), (512, 512)])
def test_label_is_the_same_at_every_size(size: tuple[int, int]) -> None:
    for index in (0, 4, 8):
        reference, other = (synthesise(9, size=s, ranges=BARE, index=index) for s in ((224, 224), size))
        assert other["image"].shape == (*size, 3) and other["mask"].shape == size
        assert reference["area_cm2"].numpy() == other["area_cm2"].numpy()


def test_scale_grows_with_the_image() -> None:
    small, large = (synthesise(9, size=(side, side), ranges=BARE, index=0) for side in (128, 384))
    assert float(large["px_per_mm"]) == pytest.approx(3 * float(small["px_per_mm"]), rel=1e-4)
    shrunk = cv2.resize(large["mask"].numpy().astype(np.float32), (128, 128), interpolation=cv2.INTER_AREA)
    assert np.mean((shrunk > 0.5) != small["mask"].numpy()) < 0.005


def test_scenes_differ_between_seeds_and_indices() -> None:
    places = itertools.product((0, 1), (0, 4, 8))
    made = (synthesise(seed, size=(64, 64), ranges=BARE, index=index) for seed, index in places)
    areas = {float(sample["area_cm2"]) for sample in made}
    assert len(areas) == 6


def test_parameters_are_sampled_from_their_ranges() -> None:
    sample = tf.function(lambda index: _flatten(sample_scene(0, index, ONE_KIND)))
    table = np.stack([sample(tf.constant(index, tf.int64)).numpy() for index in range(400)])
    for (part, field), values in zip(_fields(), table.T, strict=True):
        spec = getattr(ranges_of_parts(ONE_KIND)[part], field)
        if isinstance(spec, Probability):
            assert values.mean() == pytest.approx(spec.p, abs=0.1), field
            continue
        if isinstance(spec, Choice):
            shares = np.bincount(values.astype(int), minlength=len(spec.names)) / len(values)
            np.testing.assert_allclose(shares, spec.weights, atol=0.1, err_msg=field)
            continue
        low, high = bounds(spec)
        assert low - 1e-5 <= values.min() and values.max() <= high + 1e-5, field
        assert np.ptp(values) >= 0.95 * (high - low), field
        assert values.mean() == pytest.approx((low + high) / 2, abs=max(0.08 * (high - low), 1e-5)), field


def _flatten(scene: Scene) -> tf.Tensor:
    parts = parts_of(scene)
    return tf.stack([tf.cast(getattr(parts[part], field), tf.float32) for part, field in _fields()])


def test_parts_have_streams_of_their_own() -> None:
    """A field more in one part changes no number of another; a longer part keeps its first numbers."""

    @dataclasses.dataclass(frozen=True)
    class LongerPaper(PaperParams[Any]):
        watermark: Any = (0.0, 1.0)

    longer = dataclasses.replace(SINGLY, paper=LongerPaper())
    one, other = (parts_of(sample_scene(3, 5, ranges)) for ranges in (SINGLY, longer))
    assert one.keys() == other.keys()
    for part, params in one.items():
        for field, value in fields_of(params).items():
            assert value.numpy() == getattr(other[part], field).numpy(), (part, field)
    values = [value.numpy() for params in one.values() for value in fields_of(params).values()]
    numbers = [float(value) for value in values if value.dtype == np.float32]
    # Each prop has its own direction, gap and turn: few values coincide, those of ranges of one number.
    assert len(set(numbers)) >= len(numbers) - 8


def test_kinds_of_leaves_are_as_frequent_as_their_weights() -> None:
    lengths = {"beech": (10.0, 11.0), "oak": (20.0, 21.0), "ovate": (30.0, 31.0)}
    weights = {"beech": 3.0, "oak": 1.0, "ovate": 0.0}
    leaf = {
        name: (weights[name], dataclasses.replace(SINGLY.leaf[name][1], length_mm=length))
        for name, length in lengths.items()
    }
    ranges: Ranges = dataclasses.replace(SINGLY, leaf=leaf)
    length = tf.function(lambda index: sample_scene(0, index, ranges).leaf.length_mm)
    drawn = np.array([float(length(tf.constant(index, tf.int64))) for index in range(400)])
    assert np.mean(drawn < 15) == pytest.approx(0.75, abs=0.06) and drawn.max() < 25
