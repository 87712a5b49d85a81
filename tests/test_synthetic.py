"""The generator: the same bytes however it is driven."""

import itertools
from typing import Any

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, only

from laesi_tf.data import synthetic
from laesi_tf.data.synthetic import synthetic_batches, synthetic_samples
from laesi_tf.synthesis import synthesise

SIZE = (48, 64)
Picture = dict[str, np.ndarray]
# Few components, so that a graph is built in little time where what they look like is not the matter.
SIMPLE = only("ruling", "sensor_noise", "coin")


@pytest.fixture(scope="module")
def reference() -> list[Picture]:
    """Pictures 0 to 7 of the stream of seed 3 with every component, one at a time."""
    return list(synthetic_samples(seed=3, size=SIZE, count=8, parallel=1).as_numpy_iterator())


@pytest.fixture(scope="module")
def simple() -> list[Picture]:
    """The same with few components."""
    return list(synthetic_samples(seed=3, size=SIZE, ranges=SIMPLE, count=8, parallel=1).as_numpy_iterator())


def require_same(found: Picture, expected: Picture) -> None:
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        np.testing.assert_array_equal(found[key], value, err_msg=key)


def test_parallel_work_gives_the_same_bytes_in_the_same_order(reference: list[Picture]) -> None:
    made = synthetic_samples(seed=3, size=SIZE, count=8, parallel=4).as_numpy_iterator()
    for found, expected in zip(made, reference, strict=True):
        require_same(found, expected)


def test_starting_later_gives_the_same_bytes(simple: list[Picture]) -> None:
    made = list(synthetic_samples(seed=3, size=SIZE, ranges=SIMPLE, start=5, count=3).as_numpy_iterator())
    assert [int(picture["index"]) for picture in made] == [5, 6, 7]
    for found, expected in zip(made, simple[5:], strict=True):
        require_same(found, expected)


def test_calling_it_without_a_dataset_gives_each_pass_as_well(reference: list[Picture]) -> None:
    for index, expected in enumerate(reference):  # which a dataset makes four passes at a time
        alone = synthesise(3, size=SIZE, index=index)
        for key in ("area_cm2", "px_per_mm", "tilt_deg", "to_px", "kind"):
            np.testing.assert_allclose(alone[key], expected[key], rtol=1e-5, atol=1e-5, err_msg=key)
        assert np.mean(alone["mask"].numpy() != expected["mask"]) < 1e-3
        # A last bit rounded otherwise may be another byte; other light would be other bytes all over.
        assert np.mean(np.abs(alone["image"].numpy().astype(int) - expected["image"]) > 1) < 1e-3


def test_a_stream_may_begin_and_end_within_a_leaf(simple: list[Picture]) -> None:
    for start, stop in itertools.combinations(range(8), 2):
        made = synthetic_samples(seed=3, size=SIZE, ranges=SIMPLE, start=start, count=stop - start)
        indices = [int(index) for index in made.map(lambda picture: picture["index"])]
        assert indices == list(range(start, stop))


@pytest.mark.parametrize("batch_size", [1, 3])
def test_batches_are_the_pictures_in_order(simple: list[Picture], batch_size: int) -> None:
    made = synthetic_batches(task="area", batch_size=batch_size, seed=3, size=SIZE, ranges=SIMPLE, count=8)
    images = [image.numpy() for image, _ in made]
    assert [len(image) for image in images] == {1: [1] * 8, 3: [3, 3, 2]}[batch_size]
    np.testing.assert_array_equal(np.concatenate(images), [picture["image"] for picture in simple])


def test_shapes_are_known_before_a_picture_is_made() -> None:
    made = synthetic_samples(seed=0, size=SIZE, ranges=SIMPLE).element_spec
    assert made["image"] == tf.TensorSpec([*SIZE, 3], tf.uint8) and made["mask"].shape == SIZE
    assert made["area_cm2"] == tf.TensorSpec([], tf.float32) and made["to_px"].shape == (3, 3)
    assert made["index"] == tf.TensorSpec([], tf.int64)


def test_targets() -> None:
    options: dict[str, Any] = {"batch_size": 4, "seed": 1, "size": SIZE, "ranges": SIMPLE, "count": 4}
    (_, area), (_, mask), (_, both) = (
        next(iter(synthetic_batches(task=task, **options))) for task in ("area", "mask", "both")
    )
    made = list(synthetic_samples(seed=1, size=SIZE, ranges=SIMPLE, count=4).as_numpy_iterator())
    columns = [[p["area_cm2"], p["px_per_mm"], p["mask"].mean()] for p in made]
    np.testing.assert_allclose(area, columns, rtol=1e-5)
    np.testing.assert_array_equal(mask, [picture["mask"] for picture in made])
    np.testing.assert_array_equal(both["area"], area)
    np.testing.assert_array_equal(both["mask"], mask)


def test_passes_over_one_leaf() -> None:
    def areas(**options: int) -> list[float]:
        made = synthetic_samples(seed=0, size=(32, 32), ranges=SIMPLE, count=8, **options).as_numpy_iterator()
        return [float(picture["area_cm2"]) for picture in made]

    assert len(set(areas(passes=1))) == 8
    two, usual = areas(passes=2), areas()
    assert two[::2] == two[1::2] and len(set(two)) == 4
    assert len(set(usual)) == 8 // RENDERING_2.lighting_passes


def test_training_validation_and_test_share_no_picture() -> None:
    stretches = synthetic.TRAIN_INDICES, synthetic.VALIDATION_INDICES, synthetic.TEST_INDICES
    for (start, stop), (other, _) in itertools.pairwise(stretches):
        assert start < stop <= other
    made = [
        next(iter(synthetic_samples(seed=0, size=(32, 32), ranges=SIMPLE, start=start, count=1)))
        for start, _ in stretches
    ]
    assert len({float(picture["area_cm2"]) for picture in made}) == 3


def test_a_stream_without_count_goes_on() -> None:
    far = next(iter(synthetic_samples(seed=0, size=(32, 32), ranges=SIMPLE, start=10**12 + 1)))
    assert int(far["index"]) == 10**12 + 1
