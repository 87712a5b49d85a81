"""Leaves that are pasted onto other images of a batch."""

import numpy as np
import pytest
import tensorflow as tf
from green import LEAF, PAPER, disk, photo

from laesi_tf.common.errors import InputError
from laesi_tf.data.copy_paste import paste_leaves
from laesi_tf.training.config import TrainConfig

SIZE = (96, 128)


@pytest.fixture(scope="module")
def batch() -> tuple[np.ndarray, np.ndarray]:
    """Return two blank sheets and two with a leaf, from which leaves are pasted onto the former."""
    blank = np.full((*SIZE, 3), PAPER, np.uint8)
    leaf = disk(*SIZE)
    masks = np.stack([np.zeros_like(leaf), np.zeros_like(leaf), leaf, leaf]).astype(np.uint8)
    return np.stack([blank, blank, photo(*SIZE), photo(*SIZE)]), masks


def paste(batch: tuple[np.ndarray, np.ndarray], share: float) -> tuple[np.ndarray, np.ndarray]:
    images, masks = paste_leaves(*map(tf.constant, batch), seed=tf.constant([1, 2]), share=share)
    assert images.dtype == tf.uint8 and masks.dtype == tf.uint8
    return images.numpy(), masks.numpy()


def test_the_mask_is_where_the_pasted_leaf_is(batch: tuple[np.ndarray, np.ndarray]) -> None:
    assert LEAF[1] - LEAF[0] > 60
    images, masks = paste(batch, 1.0)
    for index in (0, 1):
        green = images[index, ..., 1].astype(int) - images[index, ..., 0] > 60
        assert 0.02 * disk(*SIZE).sum() < masks[index].sum() <= disk(*SIZE).sum()
        assert (green == masks[index]).mean() > 0.99
    # A leaf that was there stays a leaf.
    assert (masks[2:] >= batch[1][2:]).all()


def test_the_pasted_leaf_has_a_shadow(batch: tuple[np.ndarray, np.ndarray]) -> None:
    images, masks = paste(batch, 1.0)
    paper = images[0][masks[0] == 0].astype(int).max(axis=-1)
    assert paper.min() < PAPER[0] - 5 and np.median(paper) == PAPER[0]


def test_only_a_share_of_the_batch_is_changed(batch: tuple[np.ndarray, np.ndarray]) -> None:
    images, masks = paste(batch, 0.25)
    assert masks[0].any()
    np.testing.assert_array_equal(images[1:], batch[0][1:])
    np.testing.assert_array_equal(masks[1:], batch[1][1:])


def test_the_same_seed_pastes_the_same(batch: tuple[np.ndarray, np.ndarray]) -> None:
    np.testing.assert_array_equal(paste(batch, 1.0)[0], paste(batch, 1.0)[0])


def test_only_masks_can_be_trained_with_pasted_leaves() -> None:
    assert TrainConfig(task="mask", copy_paste=0.3).copy_paste == 0.3
    with pytest.raises(InputError, match="copy_paste"):
        TrainConfig(task="area", copy_paste=0.3)
