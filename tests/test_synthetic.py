"""Synthetic samples: the same bytes for any batch size, parallelism and order."""

import itertools
from typing import Any

import numpy as np
import pytest
import tensorflow as tf
from scenes import RENDERING_2, only

from laesi_tf.data import synthetic
from laesi_tf.data.synthetic import synthetic_batches, synthetic_samples
from laesi_tf.synthesis import synthesise
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import make_task

SIZE = (48, 64)
Sample = dict[str, np.ndarray]
# Few components, so that a graph is built quickly if the looks do not matter.
SIMPLE = only("ruling", "sensor_noise", "coin")


@pytest.fixture(scope="module")
def reference() -> list[Sample]:
    """Samples 0 to 7 of the stream of seed 3 with every component, one at a time."""
    return list(synthetic_samples(seed=3, size=SIZE, count=8, parallel=1).as_numpy_iterator())


@pytest.fixture(scope="module")
def simple() -> list[Sample]:
    """The same with few components."""
    return list(synthetic_samples(seed=3, size=SIZE, ranges=SIMPLE, count=8, parallel=1).as_numpy_iterator())


def require_same(actual: Sample, expected: Sample) -> None:
    assert actual.keys() == expected.keys()
    for key, value in expected.items():
        np.testing.assert_array_equal(actual[key], value, err_msg=key)


def test_parallel_work_gives_the_same_bytes_in_the_same_order(reference: list[Sample]) -> None:
    samples = synthetic_samples(seed=3, size=SIZE, count=8, parallel=4).as_numpy_iterator()
    for actual, expected in zip(samples, reference, strict=True):
        require_same(actual, expected)


def test_starting_later_gives_the_same_bytes(simple: list[Sample]) -> None:
    samples = list(synthetic_samples(seed=3, size=SIZE, ranges=SIMPLE, start=5, count=3).as_numpy_iterator())
    assert [int(sample["index"]) for sample in samples] == [5, 6, 7]
    for actual, expected in zip(samples, simple[5:], strict=True):
        require_same(actual, expected)


def test_calling_it_without_a_dataset_gives_each_pass_as_well(reference: list[Sample]) -> None:
    for index, expected in enumerate(reference):  # which a dataset makes four passes at a time
        alone = synthesise(3, size=SIZE, index=index)
        for key in ("area_cm2", "px_per_mm", "tilt_deg", "to_px", "kind"):
            np.testing.assert_allclose(alone[key], expected[key], rtol=1e-5, atol=1e-5, err_msg=key)
        assert np.mean(alone["mask"].numpy() != expected["mask"]) < 1e-3
        # A last bit rounded otherwise may be another byte; other light would be other bytes all over.
        assert np.mean(np.abs(alone["image"].numpy().astype(int) - expected["image"]) > 1) < 1e-3


def test_a_stream_may_begin_and_end_within_a_leaf(simple: list[Sample]) -> None:
    for start, stop in ((0, 3), (1, 2), (3, 6), (4, 8)):  # a leaf has four lighting passes
        samples = synthetic_samples(seed=3, size=SIZE, ranges=SIMPLE, start=start, count=stop - start)
        indices = [int(index) for index in samples.map(lambda sample: sample["index"])]
        assert indices == list(range(start, stop))


@pytest.mark.parametrize("batch_size", [1, 3])
def test_batches_are_the_samples_in_order(simple: list[Sample], batch_size: int) -> None:
    samples = synthetic_batches(
        make_target=lambda sample: sample["area_cm2"],
        batch_size=batch_size,
        seed=3,
        size=SIZE,
        ranges=SIMPLE,
        count=8,
    )
    images = [image.numpy() for image, _ in samples]
    assert [len(image) for image in images] == {1: [1] * 8, 3: [3, 3, 2]}[batch_size]
    np.testing.assert_array_equal(np.concatenate(images), [sample["image"] for sample in simple])


def test_shapes_are_known_before_a_sample_is_rendered() -> None:
    samples = synthetic_samples(seed=0, size=SIZE, ranges=SIMPLE).element_spec
    assert samples["image"] == tf.TensorSpec([*SIZE, 3], tf.uint8) and samples["mask"].shape == SIZE
    assert samples["area_cm2"] == tf.TensorSpec([], tf.float32) and samples["to_px"].shape == (3, 3)
    assert samples["index"] == tf.TensorSpec([], tf.int64)


def test_targets_of_the_tasks() -> None:
    options: dict[str, Any] = {"batch_size": 4, "seed": 1, "size": SIZE, "ranges": SIMPLE, "count": 4}
    tasks = [make_task(TrainConfig(task=name)) for name in ("area", "mask")]
    (_, area), (_, mask) = (
        next(iter(synthetic_batches(make_target=task.make_target, **options))) for task in tasks
    )
    samples = list(synthetic_samples(seed=1, size=SIZE, ranges=SIMPLE, count=4).as_numpy_iterator())
    columns = [[s["area_cm2"], s["px_per_mm"], s["mask"].mean()] for s in samples]
    np.testing.assert_allclose(area, columns, rtol=1e-5)
    np.testing.assert_array_equal(mask, [sample["mask"] for sample in samples])


def test_passes_over_one_leaf() -> None:
    def areas(**options: int) -> list[float]:
        samples = synthetic_samples(
            seed=0, size=(32, 32), ranges=SIMPLE, count=8, **options
        ).as_numpy_iterator()
        return [float(sample["area_cm2"]) for sample in samples]

    assert len(set(areas(passes=1))) == 8
    two, usual = areas(passes=2), areas()
    assert two[::2] == two[1::2] and len(set(two)) == 4
    assert len(set(usual)) == 8 // RENDERING_2.lighting_passes


def test_training_validation_and_test_share_no_sample() -> None:
    intervals = synthetic.TRAIN_INDICES, synthetic.VALIDATION_INDICES, synthetic.TEST_INDICES
    for (start, stop), (other, _) in itertools.pairwise(intervals):
        assert start < stop <= other
    samples = [
        next(iter(synthetic_samples(seed=0, size=(32, 32), ranges=SIMPLE, start=start, count=1)))
        for start, _ in intervals
    ]
    assert len({float(sample["area_cm2"]) for sample in samples}) == 3


def test_a_stream_without_count_goes_on() -> None:
    far = next(iter(synthetic_samples(seed=0, size=(32, 32), ranges=SIMPLE, start=10**12 + 1)))
    assert int(far["index"]) == 10**12 + 1
