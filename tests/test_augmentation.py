"""The nine augmentations against OpenCV, scikit-image and arithmetic, eagerly and inside tf.data."""

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import only
from skimage import color

from laesi_tf.common.errors import InputError
from laesi_tf.data import augmentation, augmentation_ops
from laesi_tf.data.augmentation import AUGMENTATIONS, augmentation_flags
from laesi_tf.synthesis import synthesise

SEEDS = st.integers(0, 2**31 - 1)
FAST = settings(max_examples=12, deadline=None)


def seed(number: int) -> tf.Tensor:
    return tf.constant([number, 7], tf.int64)


def make_sample(size: tuple[int, int] = (40, 60)) -> dict[str, tf.Tensor]:
    """A smooth coloured image with a disc as its leaf, well within range."""
    y, x = np.mgrid[: size[0], : size[1]].astype(np.float32)
    image = np.stack([90 + x, 70 + 2 * y, 140 - 0.5 * x - 0.5 * y], axis=-1)
    mask = (np.hypot(x - size[1] * 0.6, y - size[0] * 0.45) < min(size) * 0.25).astype(np.uint8)
    image[mask > 0] = (60, 110, 40)
    return {
        "image": tf.constant(image),
        "mask": tf.constant(mask),
        "area_cm2": tf.constant(12.5),
        "px_per_mm": tf.constant(3.0),
        "to_px": tf.constant([[3.0, 0.2, 20.0], [-0.1, 3.0, 15.0], [0.0, 0.001, 1.0]]),
    }


def halves(upper: float, lower: float) -> dict[str, tf.Tensor]:
    """A grey image [180, 120, 3] of two levels."""
    return {"image": tf.concat([tf.fill([90, 120, 3], float(upper)), tf.fill([90, 120, 3], float(lower))], 0)}


@FAST
@given(number=SEEDS)
def test_brightness_adds_the_same_everywhere(number: int) -> None:
    before = make_sample()["image"].numpy()
    added = float(augmentation_ops.random_uniform(seed(number), *augmentation_ops.BRIGHTNESS))
    after = augmentation_ops.adjust_brightness(make_sample(), seed(number))["image"]
    # cv2.add saturates as well.
    expected = np.clip(cv2.add(before, np.full_like(before, added)), 0, 255)
    np.testing.assert_allclose(after, expected, atol=1e-3)


@FAST
@given(number=SEEDS)
def test_contrast_stretches_about_each_channels_mean(number: int) -> None:
    before = make_sample()["image"].numpy()
    factor = float(augmentation_ops.random_uniform(seed(number), *augmentation_ops.CONTRAST))
    mean = np.array(cv2.mean(before)[:3], np.float32)
    after = augmentation_ops.adjust_contrast(make_sample(), seed(number))["image"]
    np.testing.assert_allclose(after, np.clip(mean + factor * (before - mean), 0, 255), atol=0.01)


@FAST
@given(number=SEEDS)
def test_hue_rotates_the_colour_wheel(number: int) -> None:
    hsv = color.rgb2hsv(make_sample()["image"].numpy() / 255)
    hsv[..., 0] = (
        hsv[..., 0] + float(augmentation_ops.random_uniform(seed(number), *augmentation_ops.HUE))
    ) % 1
    after = augmentation_ops.shift_hue(make_sample(), seed(number))["image"]
    np.testing.assert_allclose(after, 255 * color.hsv2rgb(hsv), atol=0.05)


@FAST
@given(number=SEEDS)
def test_saturation_scales_that_of_hsv(number: int) -> None:
    hsv = color.rgb2hsv(make_sample()["image"].numpy() / 255)
    hsv[..., 1] = np.clip(
        hsv[..., 1] * float(augmentation_ops.random_uniform(seed(number), *augmentation_ops.SATURATION)), 0, 1
    )
    after = augmentation_ops.adjust_saturation(make_sample(), seed(number))["image"]
    np.testing.assert_allclose(after, 255 * color.hsv2rgb(hsv), atol=0.05)


def test_flip_mirrors_half_of_the_images() -> None:
    mirrored = 0
    for number in range(40):
        after = augmentation_ops.flip_left_right(make_sample(), seed(number))
        expected = make_sample()["image"].numpy(), make_sample()["mask"].numpy()
        if not np.array_equal(after["image"], expected[0]):
            expected = cv2.flip(expected[0], 1), cv2.flip(expected[1], 1)
            mirrored += 1
        np.testing.assert_array_equal(after["image"], expected[0])
        np.testing.assert_array_equal(after["mask"], expected[1])
    assert 10 <= mirrored <= 30


@pytest.mark.parametrize(("size", "expected"), [((40, 40), {0, 1, 2, 3}), ((40, 60), {0, 2})])
def test_quarter_turns_equal_those_of_opencv(size: tuple[int, int], expected: set[int]) -> None:
    before, seen = make_sample(size), set()
    turns: dict[int, Callable[[np.ndarray], np.ndarray]] = {
        0: lambda field: field,
        1: lambda field: cv2.rotate(field, cv2.ROTATE_90_COUNTERCLOCKWISE),
        2: lambda field: cv2.rotate(field, cv2.ROTATE_180),
        3: lambda field: cv2.rotate(field, cv2.ROTATE_90_CLOCKWISE),
    }
    for number in range(30):
        after = augmentation_ops.rotate_quarter_turns(before, seed(number))
        image, mask = before["image"].numpy(), before["mask"].numpy()
        (match,) = (k for k, turn in turns.items() if np.array_equal(after["image"], turn(image)))
        np.testing.assert_array_equal(after["mask"], turns[match](mask))
        seen.add(match)
    assert seen == expected


@FAST
@given(number=SEEDS, size=st.sampled_from([(48, 48), (40, 60)]))
def test_rotation_equals_that_of_opencv_with_the_border_median_outside(
    number: int, size: tuple[int, int]
) -> None:
    before = make_sample(size)
    angle = float(augmentation_ops.random_uniform(seed(number), -math.pi, math.pi))
    height, width = size
    box = cv2.boxPoints(((0.0, 0.0), (float(width), float(height)), math.degrees(angle)))
    reach = np.ptp(box, axis=0)
    shrink = min(width / reach[0], height / reach[1])
    # OpenCV turns counter-clockwise on screen and counts from the first pixel's centre.
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -math.degrees(angle), shrink)
    image = before["image"].numpy()
    ground = np.median(np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]), axis=0)
    expected = cv2.warpAffine(image - ground, matrix, (width, height)) + ground
    after = augmentation_ops.rotate(before, seed(number))
    # OpenCV rounds positions to 1/32 of a pixel, and medians of an even count differ by half a step.
    off = np.abs(after["image"].numpy() - expected)
    assert off.mean() < 1.0 and np.percentile(off, 95) < 4.0
    mask = cv2.warpAffine(before["mask"].numpy().astype(np.float32), matrix, (width, height)) >= 0.5
    assert np.mean(mask != after["mask"].numpy()) < 0.01


@FAST
@given(number=SEEDS, name=st.sampled_from(["flip", "rotation90", "rotation"]))
def test_geometric_augmentations_transform_scale_and_camera(number: int, name: str) -> None:
    before = synthesise(3, size=(96, 96), ranges=only(), index=number % 50)
    before["image"] = tf.cast(before["image"], tf.float32)
    after = AUGMENTATIONS[name](before, seed(number))
    assert float(after["area_cm2"]) == float(before["area_cm2"])
    # The leaf's middle stays where the camera says it is: the sheet's origin is the middle of its box.
    seen = after["to_px"].numpy() @ [0, 0, 1]
    expected = before["to_px"].numpy() @ [0, 0, 1]
    ys, xs = np.nonzero(after["mask"].numpy())
    old_ys, old_xs = np.nonzero(before["mask"].numpy())
    scale = float(after["px_per_mm"] / before["px_per_mm"])
    apart = np.hypot(*(seen[:2] / seen[2] - [xs.mean() + 0.5, ys.mean() + 0.5]))
    apart_before = np.hypot(*(expected[:2] / expected[2] - [old_xs.mean() + 0.5, old_ys.mean() + 0.5]))
    assert apart == pytest.approx(apart_before * scale, abs=0.7)
    assert len(ys) == pytest.approx(len(old_ys) * scale**2, rel=0.06, abs=6)


def test_gaussian_noise_has_equal_strength_everywhere() -> None:
    flat = halves(60, 190)
    strength, _ = tf.unstack(tf.random.split(seed(6), 2))
    expected = float(augmentation_ops.random_uniform(strength, *augmentation_ops.GAUSSIAN))
    noise = augmentation_ops.add_gaussian_noise(flat, seed(6))["image"].numpy() - flat["image"].numpy()
    assert expected > 1
    for half in (noise[:90], noise[90:]):
        assert abs(half.mean()) < 0.2 and half.std() == pytest.approx(expected, rel=0.03)


def test_poisson_noise_has_a_variance_in_proportion_to_the_light() -> None:
    flat = halves(40, 160)
    strength, _ = tf.unstack(tf.random.split(seed(5), 2))
    photons = math.exp(float(augmentation_ops.random_uniform(strength, *np.log(augmentation_ops.PHOTONS))))
    after = augmentation_ops.add_poisson_noise(flat, seed(5))["image"].numpy()
    for half, level in ((after[:90], 40), (after[90:], 160)):
        assert half.mean() == pytest.approx(level, rel=0.01)
        assert half.var() == pytest.approx(level / photons, rel=0.05)
        # Whole numbers of photons.
        np.testing.assert_allclose(half * photons, np.round(half * photons), atol=1e-2)


@pytest.mark.parametrize("name", AUGMENTATIONS)
def test_one_traced_pipeline_serves_all_sets_of_augmentations_and_equals_eager_calls(name: str) -> None:
    enabled = tf.Variable(augmentation_flags([]))
    before = make_sample((48, 48))
    before["image"] = tf.cast(before["image"], tf.uint8)
    traces = []

    def change(index: tf.Tensor) -> dict[str, tf.Tensor]:
        traces.append(name)
        return augmentation.augment_sample(before, tf.stack([index, 7]), enabled)

    pipeline = tf.data.Dataset.range(3).map(change)
    for untouched in pipeline:
        np.testing.assert_array_equal(untouched["image"], before["image"])
    enabled.assign(augmentation_flags([name]))
    changed = list(pipeline)
    for index, after in enumerate(changed):
        expected = augmentation.augment_sample(
            before, tf.constant([index, 7], tf.int64), tf.constant(augmentation_flags([name]))
        )
        assert after.keys() == before.keys()
        off = np.abs(after["image"].numpy().astype(int) - expected["image"].numpy())
        assert off.max() <= 1
    assert any(not np.array_equal(after["image"], before["image"]) for after in changed)
    assert len(traces) == 1


def test_an_image_without_mask_and_scale_is_augmented() -> None:
    bare = {"image": tf.cast(make_sample()["image"], tf.uint8)}
    after = augmentation.augment_sample(bare, seed(1), tf.constant(augmentation_flags(AUGMENTATIONS)))
    assert after.keys() == {"image"} and after["image"].shape == bare["image"].shape


def test_unknown_augmentation_is_named() -> None:
    with pytest.raises(InputError, match=r"'blur'.*brightness"):
        augmentation_flags(["blur"])
