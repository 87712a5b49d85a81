"""Compiled functions receive parameters unchanged, and give in tf.data the bytes that they give eagerly."""

import logging

import numpy as np
import pytest
import tensorflow as tf
from scenes import middle

from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.xla import compile_with_xla


@compile_with_xla
def dim(image: tf.Tensor, light: LightParams, offset: float) -> tf.Tensor:
    return image * tf.where(light.glass, light.strength, 1.0) + offset


def test_parameters_keep_their_numbers_and_truth_values() -> None:
    image = tf.ones([2, 3])
    for glass, expected in ((True, 0.25), (False, 1.0)):
        lit = middle(LightParams(), glass=glass, strength=0.25)
        np.testing.assert_array_equal(dim(image, lit, 0.5), np.full((2, 3), expected + 0.5))


def test_eagerly_and_in_a_dataset_alike() -> None:
    lit = middle(LightParams(), glass=True, strength=0.3)
    images = tf.random.stateless_uniform([4, 5, 7], [1, 2])
    made = tf.data.Dataset.from_tensor_slices(images).map(lambda image: dim(image, lit, 0.1))
    for image, found in zip(images, made, strict=True):
        np.testing.assert_array_equal(dim(image, lit, 0.1), found)


def test_compiling_for_many_static_arguments_prints_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    image, light = tf.ones([2, 3]), middle(LightParams(), glass=True, strength=0.3)
    with caplog.at_level(logging.WARNING, "tensorflow"):
        for number in range(12):
            dim(image, light, 0.01 * number)
    assert not caplog.records
