import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from skimage.metrics import contingency_table

from laesi_tf.common import metrics

AREAS = st.lists(
    st.tuples(st.floats(0.01, 1e4), st.floats(0.01, 1e4)), min_size=1, max_size=30
)  # (predicted, true)
MASKS = hnp.arrays(np.uint8, st.tuples(st.integers(1, 5), st.just(7), st.just(6)), elements=st.integers(0, 1))


@given(AREAS)
def test_area_metrics_equal_those_of_a_loop_over_leaves(pairs):
    predicted, true = zip(*pairs, strict=True)
    errors = sorted(100.0 * abs(found - truth) / truth for found, truth in pairs)
    assert metrics.mre(predicted, true) == pytest.approx(sum(errors) / len(errors))
    assert metrics.median_relative_error(predicted, true) == pytest.approx(np.median(errors))
    place = 0.9 * (len(errors) - 1)
    low, high = errors[int(place)], errors[min(int(place) + 1, len(errors) - 1)]
    assert metrics.p90_relative_error(predicted, true) == pytest.approx(low + (place % 1) * (high - low))


@given(st.data())
def test_mask_metrics_equal_those_of_skimages_contingency_table(data):
    true = data.draw(MASKS)
    predicted = data.draw(hnp.arrays(np.uint8, true.shape, elements=st.integers(0, 1)))
    ious, errors = [], []
    for found, truth in zip(predicted, true, strict=True):
        table = np.zeros((2, 2))
        counted = (contingency_table(truth, found) * truth.size).toarray()
        table[: counted.shape[0], : counted.shape[1]] = counted
        union = table.sum() - table[0, 0]
        ious.append(table[1, 1] / union if union else 1.0)
        if truth.any():
            errors.append(abs(table[:, 1].sum() - table[1].sum()) / table[1].sum())
    assert metrics.miou(predicted, true) == pytest.approx(np.mean(ious))
    assert metrics.mpe(predicted, true) == pytest.approx(np.mean(errors) if errors else np.nan, nan_ok=True)


def test_every_picture_counts_alike():
    true = np.zeros((2, 10, 10), np.uint8)
    true[0, :1, :2], true[1] = 1, 1
    predicted = true.copy()
    predicted[0, 0, 1] = 0
    assert metrics.miou(predicted, true) == 0.75
    assert metrics.mpe(predicted, true) == 0.25


def test_one_mask_is_a_set_of_one():
    mask = np.eye(4, dtype=bool)
    assert metrics.miou(mask, 255 * mask) == 1.0


@pytest.mark.parametrize("true", [[1.0, 0.0], [1.0, -2.0], [1.0, float("nan")], [1.0]])
def test_areas_without_a_relative_error_are_refused(true):
    with pytest.raises(ValueError, match=r"positive|shape"):
        metrics.mre([1.0, 2.0], true)


def test_masks_of_another_size_are_refused():
    with pytest.raises(ValueError, match="alike"):
        metrics.miou(np.zeros((2, 4, 4)), np.zeros((2, 4, 5)))


def test_no_leaves_have_no_figure():
    assert np.isnan([metrics.mre([], []), metrics.p90_relative_error([], [])]).all()
    assert np.isnan(metrics.mpe(np.zeros((1, 3, 3)), np.zeros((1, 3, 3))))
